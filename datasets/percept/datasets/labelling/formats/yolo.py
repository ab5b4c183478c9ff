"""YOLO: a text file for each image, in the folders that Ultralytics' trainers expect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.labelled_set import SPLITS, LabelledFrame, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["export_yolo"]

_OPENING = (
    "`images/<split>/` and `labels/<split>/`: for each image a file with a line a box, `class cx",
    "cy w h`, in shares of the image's width and height. A file without lines is an image without",
    "objects.",
    "",
    "```bash",
    "yolo detect train data=data.yaml",
    "```",
    "",
    "`data.yaml` has no `path`, so that its own folder is meant wherever the set lies. Names of",
    "classes are escaped there where they are not ASCII: not all readers open it as UTF-8.",
    "",
    "Where the file system can, an image is one file with several names: a tool that repairs one",
    "in place, as some trainers do, changes it in all folders of this data set.",
)
_LOSSES = (
    "Confidences, networks, track numbers, shares that are cut off or hidden, and the numbers of "
    "the boxes: a line is a class and four sides. `boxes_2d.parquet` has them, in the same order.",
    "Where, when and why an image was taken; `frames.parquet` has it, by the image's name.",
    "3D boxes, scans and lenses.",
)
_ALWAYS = SPLITS[:2]  # trainers refuse a file without `train` and `val`


def export_yolo(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    """Write `images/<split>/`, `labels/<split>/` and `data.yaml`.

    Numbers of classes are their places in the set's categories. `train` and `val` are there even
    without images.

    Args:
        labelled: The set.
        folder: New and empty.

    Returns:
        What YOLO cannot hold, as sentences.
    """
    numbers = {label: number for number, label in enumerate(labelled.categories)}
    used = {keyframe.split for keyframe, _ in labelled.frames()}
    splits = [split for split in SPLITS if split in used or split in _ALWAYS]
    for split in splits:
        (folder / "images" / split).mkdir(parents=True)
        (folder / "labels" / split).mkdir(parents=True)
    for keyframe, frame in labelled.frames():
        name = Path(frame.file).name
        place_file(labelled.folder / frame.file, folder / "images" / keyframe.split / name)
        path = folder / "labels" / keyframe.split / f"{frame.stem}.txt"
        path.write_text(_lines(frame, numbers), encoding="ascii")
    about: dict[str, object] = {split: f"images/{split}" for split in splits}
    about["names"] = dict(enumerate(labelled.categories))
    text = yaml.safe_dump(about, sort_keys=False, allow_unicode=False)
    (folder / "data.yaml").write_text(text, encoding="ascii")
    write_readme(folder, "YOLO", _OPENING, _LOSSES)
    return _LOSSES


def _lines(frame: LabelledFrame, numbers: dict[str, int]) -> str:
    """Return the lines of an image; eight decimals are 0.0001 px of 8,192."""
    shares = frame.boxes.boxes_px / np.array(frame.image_size * 2, dtype=np.float64)
    sides = np.column_stack(
        [(shares[:, :2] + shares[:, 2:]) / 2, shares[:, 2:] - shares[:, :2]]
    ).tolist()
    return "".join(
        f"{numbers[label]} {cx:.8f} {cy:.8f} {w:.8f} {h:.8f}\n"
        for label, (cx, cy, w, h) in zip(frame.boxes.labels, sides, strict=True)
    )
