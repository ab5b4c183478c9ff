"""Label Studio: a task for each image, the boxes of which are its prediction."""

from __future__ import annotations

import colorsys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from percept.datasets.labelling.formats.format_readme import write_readme
from percept.datasets.labelling.formats.image_box import ImageBox, each_box
from percept.datasets.labelling.formats.json_rows import write_rows
from percept.datasets.labelling.formats.xml_text import xml_text
from percept.datasets.labelling.labelled_set import Keyframe, LabelledFrame, LabelledSet
from percept.datasets.labelling.placing import place_file

__all__ = ["export_label_studio"]

_OPENING = (
    "1. Start Label Studio with this folder as the root of its local files:",
    "   `LABEL_STUDIO_LOCAL_FILES_SERVING_ENABLED=true`,",
    "   `LABEL_STUDIO_LOCAL_FILES_DOCUMENT_ROOT=<this folder>`.",
    "2. Make a project and paste `config.xml` into *Labeling Interface*, *Code*.",
    "3. In *Cloud Storage* add a source storage of *Local files* with the path",
    "   `<this folder>/images`, and do not synchronise it: without it no image is shown.",
    "4. Import `tasks.json`.",
    "",
    "All boxes of an image are one prediction, since Label Studio shows one. The id of a region is",
    "`box-` and the number of the box, `score` its confidence, `meta` its network and track.",
)
_LOSSES = (
    "Shares of a box that are cut off or hidden, and links to 3D boxes; `boxes_2d.parquet` has "
    "them, by the number of the box.",
    "That a person drew a box: it is part of the prediction, without a score.",
    "Where and why an image was taken; `frames.parquet` has it, by the image's name.",
    "3D boxes, scans and lenses.",
)
_IMAGE, _LABEL = "image", "label"
_GOLDEN = 0.6180339887498949  # steps of this share around the circle of hues never meet


def export_label_studio(labelled: LabelledSet, folder: Path) -> tuple[str, ...]:
    r"""Write `tasks.json`, `config.xml` and `images/`.

    Control characters in names of classes are spelled out, such as `\u0007`: XML has none.

    Args:
        labelled: The set.
        folder: New and empty.

    Returns:
        What Label Studio cannot hold, as sentences.
    """
    for _, frame in labelled.frames():
        place_file(labelled.folder / frame.file, folder / "images" / Path(frame.file).name)
    version = _model_version(labelled)
    with (folder / "tasks.json").open("w", encoding="ascii") as file:
        write_rows(file, (_task(*both, version) for both in labelled.frames()))
        file.write("\n")
    (folder / "config.xml").write_text(_config(labelled.categories), encoding="utf-8")
    write_readme(folder, "Label Studio", _OPENING, _LOSSES)
    return _LOSSES


def _model_version(labelled: LabelledSet) -> str:
    """Return one name for all predictions: Label Studio shows those of one version at a time."""
    sources = {source for _, frame in labelled.frames() for source in frame.boxes.sources}
    return ", ".join(sorted(sources - {""})) or "percept"


def _task(keyframe: Keyframe, frame: LabelledFrame, version: str) -> dict[str, Any]:
    data = {
        _IMAGE: f"/data/local-files/?d=images/{Path(frame.file).name}",
        "drive": keyframe.drive,
        "camera": frame.camera,
        "split": keyframe.split,
        "stamp_ns": str(frame.stamp_ns),  # a browser's numbers end at 2^53
    }
    boxes = frame.boxes
    if not len(boxes):
        return {"data": data, "predictions": []}
    result = [_region(box, frame.image_size) for box in each_box(boxes)]
    prediction: dict[str, Any] = {"model_version": version, "result": result}
    sure = boxes.confidences[np.isfinite(boxes.confidences)]
    if len(sure):
        prediction["score"] = float(sure.mean())
    return {"data": data, "predictions": [prediction]}


def _region(box: ImageBox, image_size: tuple[int, int]) -> dict[str, Any]:
    (width, height), (x1, y1, x2, y2) = image_size, box.box_px
    meta = {"source": box.source, "track_id": box.track_id}
    return {
        "id": f"box-{box.box_id}",
        "type": "rectanglelabels",
        "from_name": _LABEL,
        "to_name": _IMAGE,
        "original_width": width,
        "original_height": height,
        "image_rotation": 0,
        **({} if box.confidence is None else {"score": box.confidence}),
        "meta": {name: value for name, value in meta.items() if value is not None},
        "value": {
            "x": 100 * x1 / width,
            "y": 100 * y1 / height,
            "width": 100 * (x2 - x1) / width,
            "height": 100 * (y2 - y1) / height,
            "rotation": 0,
            "rectanglelabels": [xml_text(box.label)],
        },
    }


def _config(categories: Sequence[str]) -> str:
    """Return the labelling interface; its reader takes no declaration of an encoding."""
    view = ET.Element("View")
    ET.SubElement(view, "Image", {"name": _IMAGE, "value": f"${_IMAGE}", "zoom": "true"})
    labels = ET.SubElement(view, "RectangleLabels", {"name": _LABEL, "toName": _IMAGE})
    for number, label in enumerate(categories):
        said = {"value": xml_text(label), "background": _colour(number)}
        ET.SubElement(labels, "Label", said)
    ET.indent(view)
    return ET.tostring(view, encoding="unicode") + "\n"


def _colour(number: int) -> str:
    rgb = colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.75, 0.9)
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)
