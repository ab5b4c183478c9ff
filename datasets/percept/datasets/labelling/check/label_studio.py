"""Checks Label Studio: `tasks.json` with predictions or annotations, and `config.xml`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any
from urllib.parse import parse_qs, urlsplit

from percept.core.errors import InputError
from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part
from percept.datasets.labels.boxes import as_number
from percept.datasets.labels.xml_events import read_elements

__all__ = ["check_label_studio", "holds_label_studio"]

_TASKS, _CONFIG = "tasks.json", "config.xml"
_KIND = "rectanglelabels"
_ROUNDING = 1e-6


def holds_label_studio(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds tasks of Label Studio."""
    return f"{root}{_TASKS}" in inspection.folder.files


def check_label_studio(inspection: Inspection, root: str) -> None:
    """Check the tasks, their boxes, and the images that they name."""
    _Tasks(inspection, inspection.part(root, "label-studio")).check()


class _Config:
    """The classes of a labelling interface."""

    def __init__(self) -> None:
        self.labels: list[str] = []

    def begins(self, path: tuple[str, ...], attributes: Mapping[str, str]) -> None:
        """Take the beginning of an element."""
        if path[-2:] == ("RectangleLabels", "Label"):
            self.labels.append(attributes.get("value", ""))

    def ends(self, path: tuple[str, ...], text: str) -> None:
        """Take the end of an element."""


class _Tasks:
    def __init__(self, inspection: Inspection, part: Part) -> None:
        self._inspection = inspection
        self._part = part
        self._name = f"{part.root}{_TASKS}"
        self._labels: list[str] | None = None

    def check(self) -> None:
        """Check everything."""
        self._read_config()
        tasks = self._inspection.folder.json(self._name)
        if tasks is None:
            return
        if not isinstance(tasks, list):
            self._inspection.add("malformed", self._name, "is no list of tasks")
            return
        for index, task in enumerate(tasks):
            where = f"{self._name} task {index}"
            data = task.get("data") if isinstance(task, dict) else None
            if isinstance(data, dict):
                self._check_task(where, task, data)
            else:
                self._inspection.add("malformed", where, "has no data")

    def _read_config(self) -> None:
        name, folder, config = f"{self._part.root}{_CONFIG}", self._inspection.folder, _Config()
        if not folder.need(name, self._name):
            return
        try:
            read_elements(folder.path(name), config)
        except InputError as error:
            self._inspection.add("unreadable-file", name, error.what)
            return
        self._labels = config.labels
        self._part.classes[name] = tuple(config.labels)
        self._inspection.check_unique(name, config.labels, "class")

    def _check_task(self, where: str, task: dict[str, Any], data: dict[str, Any]) -> None:
        split = data.get("split")
        split = split if isinstance(split, str) else UNSPLIT
        file = self._file(where, data.get("image"))
        regions = list(self._regions(where, task))
        if file is not None:
            size = next((size for _, one in regions if (size := _size(one)) is not None), None)
            self._inspection.list_image(self._part, file, split, where, size=size)
        ids = [one["id"] for _, one in regions if isinstance(one.get("id"), str)]
        self._inspection.check_unique(where, ids, "region")
        for place, region in regions:
            if region.get("type") == _KIND:
                self._check_region(place, region, split)

    def _file(self, where: str, url: object) -> str | None:
        """Return the file that a task names: of local files the part behind `d=`."""
        if not isinstance(url, str):
            self._inspection.add("malformed", where, "data has no image")
            return None
        try:
            parts = urlsplit(url)
        except ValueError:
            self._inspection.add("malformed", where, f"'{url}' is no address")
            return None
        if parts.scheme or parts.netloc:
            self._inspection.add("outside-folder", where, f"'{url}'")
            return None
        named = parse_qs(parts.query).get("d", [url])[0]
        folder, root = self._inspection.folder, self._part.root
        name = folder.resolve(root, named, where)
        if name is None or name in folder.files:
            return name
        # The storage may begin above the folder: then only the end of the name is known.
        short = f"{root}images/{name.rpartition('/')[2]}"
        return short if short in folder.files else name

    def _regions(self, where: str, task: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
        for key in ("predictions", "annotations"):
            found = task.get(key, [])
            for one in found if isinstance(found, list) else [found]:
                result = one.get("result") if isinstance(one, dict) else None
                if not isinstance(result, list):
                    self._inspection.add("malformed", where, f"{key} have no list 'result'")
                    continue
                for index, region in enumerate(result):
                    place = f"{where} {key} region {index}"
                    if isinstance(region, dict):
                        yield place, region
                    else:
                        self._inspection.add("malformed", place, "is no object")

    def _check_region(self, where: str, region: dict[str, Any], split: str) -> None:
        value = region.get("value")
        if not isinstance(value, dict):
            self._inspection.add("malformed", where, "has no value")
            return
        labels = value.get(_KIND)
        label = labels[0] if isinstance(labels, list) and labels else None
        if not isinstance(label, str) or (self._labels is not None and label not in self._labels):
            self._inspection.add("unknown-class", where, f"{label!r}")
        else:
            self._part.count_box(label, split)
        shares = [as_number(value.get(key)) / 100 for key in ("x", "y", "width", "height")]
        if not all(map(math.isfinite, shares)):
            self._inspection.add("not-a-number", where, "x, y, width or height")
        elif max(shares) > 1 + _ROUNDING or min(shares) < -_ROUNDING:
            self._inspection.add("share-range", where, "x, y, width or height is not in 0..100")
        else:
            x, y, w, h = shares
            self._inspection.check_shares(where, (x, y, x + w, y + h))


def _size(region: dict[str, Any]) -> tuple[int, int] | None:
    sides = as_number(region.get("original_width")), as_number(region.get("original_height"))
    if not all(map(math.isfinite, sides)) or min(sides) < 1:
        return None
    return int(sides[0]), int(sides[1])
