"""Checks OpenLABEL 1.0.0: the parts of its schema that readers trip over, and its files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part
from percept.datasets.labels.boxes import as_number

__all__ = ["check_openlabel", "holds_openlabel"]

_CUBOIDS = (9, 10)
_SNIFFED = 4096
_MARK = b'"openlabel"'
_NEEDED = {"objects": ("name", "type"), "coordinate_systems": ("type", "parent")}

_Json = dict[str, Any]


def holds_openlabel(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds OpenLABEL."""
    return bool(_documents(inspection, root))


def check_openlabel(inspection: Inspection, root: str) -> None:
    """Check each document and the files that its frames name."""
    part = inspection.part(root, "openlabel")
    for name in _documents(inspection, root):
        _Document(inspection, part, name).check()


def _documents(inspection: Inspection, root: str) -> list[str]:
    """Return JSON files, at most one folder below, that begin as OpenLABEL does."""
    below = inspection.folder.below(root, ".json")
    if root:  # our own export holds nothing else
        return below
    return [n for n in below if n.count("/") <= 1 and _begins(inspection, n)]


def _begins(inspection: Inspection, name: str) -> bool:
    try:
        with inspection.folder.path(name).open("rb") as file:
            return _MARK in file.read(_SNIFFED)
    except OSError:
        return False


class _Document:
    def __init__(self, inspection: Inspection, part: Part, name: str) -> None:
        self._inspection = inspection
        self._part = part
        self._name = name
        self._content: _Json = {}
        self._split = UNSPLIT

    def check(self) -> None:
        """Check everything."""
        document = self._inspection.folder.json(self._name)
        if document is None:
            return
        content = document.get("openlabel") if isinstance(document, dict) else None
        metadata = content.get("metadata") if isinstance(content, dict) else None
        stated = metadata.get("schema_version") if isinstance(metadata, dict) else None
        if not isinstance(content, dict) or not isinstance(stated, str):
            told = "no openlabel with metadata and its schema_version"
            self._inspection.add("malformed", self._name, told)
            return
        self._content = content
        split = content["metadata"].get("split")
        self._split = split if isinstance(split, str) else UNSPLIT
        for key, needed in _NEEDED.items():
            self._check_entries(key, needed)
        for number, frame in self._mapping(self._content, "frames", self._name):
            self._check_frame(f"{self._name} frame {number}", frame)

    def _mapping(self, above: _Json, key: str, where: str) -> Iterator[tuple[str, _Json]]:
        found = above.get(key, {})
        if not isinstance(found, dict):
            self._inspection.add("malformed", where, f"{key} is no object")
            return
        for name, entry in found.items():
            if isinstance(entry, dict):
                yield name, entry
            else:
                self._inspection.add("malformed", where, f"{key} {name} is no object")

    def _check_entries(self, key: str, needed: tuple[str, ...]) -> None:
        for name, entry in self._mapping(self._content, key, self._name):
            lacking = [one for one in needed if not isinstance(entry.get(one), str)]
            if lacking:
                where = f"{self._name} {key} {name}"
                self._inspection.add("malformed", where, f"has no {' and '.join(lacking)}")

    def _check_frame(self, where: str, frame: _Json) -> None:
        properties = frame.get("frame_properties", {})
        if isinstance(properties, dict):
            for name, stream in self._mapping(properties, "streams", where):
                self._check_stream(f"{where} stream {name}", stream)
        known = self._content.get("objects")
        for name, entry in self._mapping(frame, "objects", where):
            if not isinstance(known, dict) or name not in known:
                self._inspection.add("unknown-id", f"{where} object {name}", "is not in objects")
            data = entry.get("object_data", {})
            if isinstance(data, dict):
                self._check_object(f"{where} object {name}", self._label(name), data)

    def _label(self, name: str) -> str:
        known = self._content.get("objects")
        entry = known.get(name) if isinstance(known, dict) else None
        return str(entry.get("type")) if isinstance(entry, dict) else "?"

    def _check_stream(self, where: str, stream: _Json) -> None:
        uri = stream.get("uri")
        if not isinstance(uri, str) or not uri:
            return
        base = self._name.rpartition("/")[0]
        name = self._inspection.folder.resolve(f"{base}/" if base else "", uri, where)
        if name is None:
            return
        if name.lower().endswith((".jpg", ".jpeg", ".png")):
            self._inspection.list_image(self._part, name, self._split, where)
        else:
            self._inspection.folder.need(name, where)

    def _check_object(self, where: str, label: str, data: _Json) -> None:
        for key, lengths in (("bbox", (4,)), ("cuboid", _CUBOIDS)):
            found = data.get(key, [])
            for one in found if isinstance(found, list) else [found]:
                value = one.get("val") if isinstance(one, dict) else None
                if not isinstance(value, list) or len(value) not in lengths:
                    self._inspection.add(
                        "malformed", where, f"{key} has no list 'val' of its length"
                    )
                    continue
                numbers = [as_number(part) for part in value]
                if key == "bbox":
                    self._part.count_box(label, self._split)
                    cx, cy, w, h = numbers
                    sides = (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2)
                    self._inspection.check_box(where, sides, None)
                else:
                    self._check_cuboid(where, numbers)

    def _check_cuboid(self, where: str, numbers: list[float]) -> None:
        self._part.solids += 1
        self._inspection.check_solid(where, [*numbers[:3], *numbers[-3:], *numbers[3:-3]])
        if len(numbers) == _CUBOIDS[1] and abs(math.hypot(*numbers[3:7]) - 1) > 1e-3:
            self._inspection.add("malformed", where, "cuboid has no unit quaternion")
