"""CVAT, XML 1.1: all images with their boxes, and the images of each camera as a video."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

from percept.datasets.labelling.formats.cvat_elements import (
    add_box,
    add_labels,
    add_texts,
    box_source,
    label_settings,
    write_document,
)
from percept.datasets.labelling.formats.cvat_video import write_videos
from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.image_box import each_box
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import SPLITS, Keyframe, LabelledFrame, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["export_cvat"]

_OPENING = (
    "Make a project and paste `labels.json` into the raw view of its constructor of labels: the",
    "attributes in it carry the numbers by which `percept dataset import` knows the boxes again.",
    "",
    "`images/`: pack its content (`annotations.xml` and `images/`) as a zip file and choose",
    "*Import dataset* in the project, format *CVAT 1.1*: each split becomes a task. Or make one",
    "task of all the images and choose *Upload annotations* with `annotations.xml`.",
    "",
    "`video/<drive>_<camera>/`: the images of one camera of one drive in the order of time, with",
    "tracks. Make a task of its `images/`, sorted by name, and choose *Upload annotations* with",
    "its `annotations.xml`. Label a drive either here or in `images/`.",
    "",
    "Pre-labels have a `score`, and the network as `model`; their source is `auto`, which CVAT's",
    "import turns into `file`. `occluded` is set where a tenth of the object or more is hidden.",
)
_LOSSES = (
    "Shares of a box that are cut off or hidden, links to 3D boxes, and all but four digits of the "
    "confidence; `boxes_2d.parquet` has them, by `box_id`.",
    "In `video/`, the split of an image; a box without a track becomes a track of one image.",
    "Where, when and why an image was taken; `frames.parquet` has it, by the image's name.",
    "3D boxes, scans and lenses.",
)


def export_cvat(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    r"""Write `labels.json`, `images/` and `video/<drive>_<camera>/`.

    Control characters in names of classes are spelled out, such as `\u0007`: XML has none.

    Args:
        labelled: The set.
        folder: New and empty.

    Returns:
        What CVAT cannot hold, as sentences.
    """
    settings = json.dumps(label_settings(labelled.categories), indent=2)
    (folder / "labels.json").write_text(settings + "\n", encoding="ascii")
    images = folder / "images"
    images.mkdir()
    rows = (_image(keyframe, frame) for keyframe, frame in labelled.frames())
    write_document(images / "annotations.xml", _meta(labelled), rows)
    for keyframe, frame in labelled.frames():
        target = images / "images" / keyframe.split / Path(frame.file).name
        place_file(labelled.folder / frame.file, target)
    write_videos(labelled, folder / "video")
    write_readme(folder, "CVAT", _OPENING, _LOSSES)
    return _LOSSES


def _meta(labelled: LabelledSet) -> ET.Element:
    """Return the `meta` of a project in which each split is a task."""
    meta = ET.Element("meta")
    project = ET.SubElement(meta, "project")
    add_texts(project, {"name": xml_text(labelled.name), "created": labelled.created})
    tasks = ET.SubElement(project, "tasks")
    splits = [keyframe.split for keyframe, _ in labelled.frames()]
    for split in SPLITS:
        if split in splits:
            size = str(splits.count(split))
            about = {"name": split, "size": size, "mode": "annotation", "subset": split}
            add_texts(ET.SubElement(tasks, "task"), about)
    add_labels(project, labelled.categories)
    return meta


def _image(keyframe: Keyframe, frame: LabelledFrame) -> ET.Element:
    width, height = frame.image_size
    about = {
        "id": str(frame.frame),
        "name": Path(frame.file).name,
        "subset": keyframe.split,
        "width": str(width),
        "height": str(height),
    }
    image = ET.Element("image", about)
    for box in each_box(frame.boxes):
        add_box(image, box, {"label": xml_text(box.label), "source": box_source(box)})
    return image
