"""Checks nuScenes: thirteen tables that refer to each other by tokens, and their files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES
from percept.datasets.labels.boxes import as_number

__all__ = ["check_nuscenes", "holds_nuscenes"]

_TABLES = (
    "attribute", "calibrated_sensor", "category", "ego_pose", "instance", "log", "map", "sample",
    "sample_annotation", "sample_data", "scene", "sensor", "visibility",
)  # fmt: skip
_REFERENCES = {
    "calibrated_sensor": {"sensor_token": "sensor"},
    "instance": {
        "category_token": "category",
        "first_annotation_token": "sample_annotation",
        "last_annotation_token": "sample_annotation",
    },
    "map": {"log_tokens": "log"},
    "sample": {"scene_token": "scene", "prev": "sample", "next": "sample"},
    "sample_annotation": {
        "sample_token": "sample",
        "instance_token": "instance",
        "attribute_tokens": "attribute",
        "visibility_token": "visibility",
        "prev": "sample_annotation",
        "next": "sample_annotation",
    },
    "sample_data": {
        "sample_token": "sample",
        "ego_pose_token": "ego_pose",
        "calibrated_sensor_token": "calibrated_sensor",
        "prev": "sample_data",
        "next": "sample_data",
    },
    "scene": {
        "log_token": "log",
        "first_sample_token": "sample",
        "last_sample_token": "sample",
    },
}
"""Which columns of a table refer to which table; an empty text refers to nothing."""
_MAY_BE_EMPTY = ("prev", "next", "visibility_token")
_LENGTHS = {"translation": 3, "rotation": 4, "size": 3}
_PLACED = ("calibrated_sensor", "ego_pose", "sample_annotation")
_POINT_BYTES = 20

_Row = dict[str, Any]


def holds_nuscenes(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds nuScenes tables."""
    return bool(_versions(inspection, root))


def check_nuscenes(inspection: Inspection, root: str) -> None:
    """Check the tables, their references, and the files that they name."""
    for version in _versions(inspection, root):
        _Tables(inspection, inspection.part(root, "nuscenes"), version).check()


def _versions(inspection: Inspection, root: str) -> list[str]:
    names = inspection.folder.below(root, "/sample_data.json")
    above = [name.rpartition("/")[0] for name in names]
    return [f"{name}/" for name in above if "/" not in name[len(root) :]]


class _Tables:
    def __init__(self, inspection: Inspection, part: Part, version: str) -> None:
        self._inspection = inspection
        self._part = part
        self._version = version
        self._rows = {name: list(self._read(name)) for name in _TABLES}
        self._tokens = {name: {r["token"] for _, r in rows} for name, rows in self._rows.items()}

    def check(self) -> None:
        """Check everything."""
        for name, rows in self._rows.items():
            where = self._file(name)
            self._inspection.check_unique(where, (row["token"] for _, row in rows), "token")
            for place, row in rows:
                self._check_references(place, row, _REFERENCES.get(name, {}))
                if name in _PLACED:
                    self._check_place(place, row)
        self._check_data()
        self._check_maps()
        self._part.solids = len(self._rows["sample_annotation"])

    def _file(self, table: str) -> str:
        return f"{self._version}{table}.json"

    def _read(self, table: str) -> Iterator[tuple[str, _Row]]:
        name = self._file(table)
        content = self._inspection.folder.json(name)
        if content is not None and not isinstance(content, list):
            self._inspection.add("malformed", name, "is no list of records")
            return
        for index, row in enumerate(content or ()):
            where = f"{name} [{index}]"
            if isinstance(row, dict) and isinstance(row.get("token"), str):
                yield where, row
            else:
                self._inspection.add("malformed", where, "is no record with a token")

    def _check_references(self, where: str, row: _Row, columns: dict[str, str]) -> None:
        for column, table in columns.items():
            value = row.get(column)
            if value == "" and column in _MAY_BE_EMPTY:
                continue
            for token in value if isinstance(value, list) else [value]:
                if not isinstance(token, str) or token not in self._tokens[table]:
                    told = f"{column} {token!r} is not in {table}"
                    self._inspection.add("unknown-id", where, told)

    def _check_place(self, where: str, row: _Row) -> None:
        for column, length in _LENGTHS.items():
            value = row.get(column)
            if column == "size" and "size" not in row and "instance_token" not in row:
                continue
            if not isinstance(value, list) or len(value) != length:
                self._inspection.add("malformed", where, f"{column} is no list of {length}")
                continue
            numbers = [as_number(one) for one in value]
            if not all(map(math.isfinite, numbers)):
                self._inspection.add("not-a-number", where, column)
            elif column == "size" and min(numbers) <= 0:
                self._inspection.add("box-empty", where, f"3D box of {value}")
            elif column == "rotation" and abs(math.hypot(*numbers) - 1) > 1e-3:
                self._inspection.add("malformed", where, "rotation is no unit quaternion")

    def _check_data(self) -> None:
        for where, row in self._rows["sample_data"]:
            name = self._inspection.folder.resolve(self._part.root, row.get("filename"), where)
            if name is None:
                continue
            if name.lower().endswith(IMAGE_SUFFIXES):
                size = _size(row)
                self._inspection.list_image(self._part, name, UNSPLIT, where, size=size)
            elif self._inspection.folder.need(name, where):
                self._check_points(name, where)

    def _check_points(self, name: str, where: str) -> None:
        if name.endswith(".pcd.bin") and self._inspection.folder.files[name].size % _POINT_BYTES:
            self._inspection.add("malformed", where, f"{name} is no rows of five float32")

    def _check_maps(self) -> None:
        held: set[object] = set()
        for where, row in self._rows["map"]:
            name = self._inspection.folder.resolve(self._part.root, row.get("filename"), where)
            if name is not None:
                self._inspection.folder.need(name, where)
            logs = row.get("log_tokens")
            if isinstance(logs, list):
                held.update(one for one in logs if isinstance(one, str))
        for where, row in self._rows["log"]:
            if row["token"] not in held:
                self._inspection.add("unknown-id", where, "no map names this log")


def _size(row: _Row) -> tuple[int, int] | None:
    sides = as_number(row.get("width")), as_number(row.get("height"))
    if not all(map(math.isfinite, sides)) or min(sides) < 1:
        return None
    return int(sides[0]), int(sides[1])
