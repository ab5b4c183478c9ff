"""The parts that CVAT's XML of images and of video share, and the file around them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from percept.datasets.labelling.formats.image_box import ImageBox
from percept.datasets.labelling.formats.xml_text import xml_text

__all__ = ["add_box", "add_labels", "add_texts", "box_source", "label_settings", "write_document"]

_HIDDEN_FROM = 0.1
"""From this share on a box has CVAT's flag `occluded`."""
_ATTRIBUTES = {"box_id": True, "object_id": False, "score": True, "model": True}
"""Attributes of a box, and whether they change along a track. CVAT's import keeps others, such as
`track_id` and `source`, for itself."""


def label_settings(categories: Sequence[str]) -> list[dict[str, Any]]:
    """Return the classes as CVAT's constructor of labels takes them as raw JSON."""
    attributes = [
        {"name": name, "mutable": mutable, "input_type": "text", "default_value": "",
         "values": [""]}
        for name, mutable in _ATTRIBUTES.items()
    ]  # fmt: skip
    return [
        {"name": xml_text(label), "type": "rectangle", "attributes": attributes}
        for label in categories
    ]


def add_labels(parent: ET.Element, categories: Sequence[str]) -> None:
    """Add `labels`, which the `meta` of a document holds."""
    labels = ET.SubElement(parent, "labels")
    for setting in label_settings(categories):
        label = ET.SubElement(labels, "label")
        add_texts(label, {"name": setting["name"], "type": setting["type"]})
        attributes = ET.SubElement(label, "attributes")
        for one in setting["attributes"]:
            attribute = ET.SubElement(attributes, "attribute")
            mutable = str(one["mutable"])
            add_texts(attribute, {**one, "mutable": mutable, "values": "\n".join(one["values"])})


def add_texts(parent: ET.Element, texts: Mapping[str, str]) -> None:
    """Add an element for each text."""
    for name, text in texts.items():
        ET.SubElement(parent, name).text = text


def add_box(parent: ET.Element, box: ImageBox, beside: Mapping[str, str]) -> None:
    """Add a `box` with its attributes.

    Args:
        parent: An `image` or a `track`.
        box: The box.
        beside: What the element says before the sides of the box.
    """
    hidden = box.occluded is not None and box.occluded >= _HIDDEN_FROM
    sides = zip(("xtl", "ytl", "xbr", "ybr"), box.box_px, strict=True)
    said = {
        **beside,
        "occluded": str(int(hidden)),
        **{name: f"{side:.4f}" for name, side in sides},
        "z_order": "0",
    }
    element = ET.SubElement(parent, "box", said)
    for name, value in _values(box).items():
        # One that is missing would be taken over from the track's box before.
        ET.SubElement(element, "attribute", {"name": name}).text = value


def box_source(box: ImageBox) -> str:
    """Return CVAT's word for where a box is from."""
    return "manual" if box.source is None else "auto"


def write_document(path: Path, meta: ET.Element, rows: Iterable[ET.Element]) -> None:
    """Write a document of version 1.1 without holding its rows.

    Args:
        path: The file.
        meta: Its `meta`.
        rows: Its images or tracks.
    """
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write('<?xml version="1.0" encoding="utf-8"?>\n')
        file.write("<annotations>\n<version>1.1</version>\n")
        for element in chain([meta], rows):
            ET.indent(element)
            file.write(ET.tostring(element, encoding="unicode") + "\n")
        file.write("</annotations>\n")


def _values(box: ImageBox) -> dict[str, str]:
    return {
        "box_id": str(box.box_id) if box.box_id else "",
        "object_id": "" if box.track_id is None else str(box.track_id),
        "score": "" if box.confidence is None else f"{box.confidence:.4f}",
        "model": xml_text(box.source or ""),
    }
