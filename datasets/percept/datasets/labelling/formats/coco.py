"""COCO: a file of instances for each split, and its images.

Lin et al., "Microsoft COCO: Common Objects in Context", ECCV 2014; the keys are those that
pycocotools reads, with `attributes` beside them as CVAT and datumaro have them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.image_box import ImageBox, each_box
from percept.datasets.labelling.formats.json_rows import write_rows
from percept.datasets.labelling.labelled_set import SPLITS, LabelledFrame, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["export_coco"]

_OPENING = (
    "`annotations/instances_<split>.json` with the images of `images/<split>/`. Ids of images and",
    "classes begin at 1; the id of an annotation is the number of the box in `boxes_2d.parquet`.",
    "Its `attributes` are what is known of a pre-label: `score`, network, track, 3D box, and the",
    "shares of it that are cut off or hidden.",
    "",
    "```python",
    "from pycocotools.coco import COCO",
    'coco = COCO("annotations/instances_train.json")',
    "```",
)
_LOSSES = (
    "Where, when and why an image was taken; `frames.parquet` has it, by the image's name.",
    "3D boxes, scans and lenses.",
)
_LICENCE_ID = 1


def export_coco(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write `annotations/instances_<split>.json` and `images/<split>/`.

    An annotation has the id of its box; ids of images are those of the set and one more, those of
    categories the place in the set's and one more. A split without images has no file.

    Args:
        labelled: The set.
        folder: New and empty.

    Returns:
        What COCO cannot hold, as sentences.
    """
    (folder / "annotations").mkdir()
    for split in SPLITS:
        frames = [frame for keyframe, frame in labelled.frames() if keyframe.split == split]
        if not frames:
            continue
        for frame in frames:
            name = Path(frame.file).name
            place_file(labelled.folder / frame.file, folder / "images" / split / name)
        _write(folder / "annotations" / f"instances_{split}.json", labelled, frames)
    write_readme(folder, "COCO", _OPENING, _LOSSES)
    return _LOSSES


def _write(path: Path, labelled: LabelledSet, frames: Sequence[LabelledFrame]) -> None:
    numbers = {label: number for number, label in enumerate(labelled.categories, 1)}
    info = {"description": labelled.name, "version": "1.0", "date_created": labelled.created}
    with path.open("w", encoding="ascii") as file:
        file.write(f'{{"info": {json.dumps(info)},\n"licenses": ')
        write_rows(file, _licences(labelled))
        file.write(',\n"categories": ')
        write_rows(file, ({"id": n, "name": label} for label, n in numbers.items()))
        file.write(',\n"images": ')
        write_rows(file, (_image(frame, labelled) for frame in frames))
        file.write(',\n"annotations": ')
        write_rows(
            file,
            (
                _annotation(box, frame, numbers[box.label])
                for frame in frames
                for box in each_box(frame.boxes)
            ),
        )
        file.write("}\n")


def _licences(labelled: LabelledSet) -> Iterator[dict[str, Any]]:
    if labelled.licence:
        yield {"id": _LICENCE_ID, "name": labelled.licence, "url": ""}


def _image(frame: LabelledFrame, labelled: LabelledSet) -> dict[str, Any]:
    width, height = frame.image_size
    licence = {"license": _LICENCE_ID} if labelled.licence else {}
    name = Path(frame.file).name
    return {"id": frame.frame + 1, "file_name": name, "width": width, "height": height, **licence}


def _annotation(box: ImageBox, frame: LabelledFrame, category: int) -> dict[str, Any]:
    x1, y1, x2, y2 = box.box_px
    attributes = {
        "score": box.confidence,
        "source": box.source,
        "track_id": box.track_id,
        "box_3d": box.solid,
        "truncated": box.truncated,
        "occluded": box.occluded,
    }
    return {
        "id": box.box_id,
        "image_id": frame.frame + 1,
        "category_id": category,
        "bbox": [x1, y1, x2 - x1, y2 - y1],
        "area": (x2 - x1) * (y2 - y1),
        "iscrowd": 0,
        "segmentation": [],
        "attributes": {name: value for name, value in attributes.items() if value is not None},
    }
