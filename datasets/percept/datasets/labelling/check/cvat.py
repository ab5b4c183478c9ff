"""Checks CVAT's XML 1.1: of images, and of videos with tracks."""

from __future__ import annotations

from collections.abc import Mapping

from percept.core.errors import InputError
from percept.datasets.labelling.check.inspection import UNSPLIT, Inspection, Part, as_finite
from percept.datasets.labelling.check.pictures import IMAGE_SUFFIXES
from percept.datasets.labels.xml_events import read_elements

__all__ = ["check_cvat", "holds_cvat"]

_NAME = "annotations.xml"
_SIDES = ("xtl", "ytl", "xbr", "ybr")


def holds_cvat(inspection: Inspection, root: str) -> bool:
    """Return whether a folder holds CVAT's documents."""
    return bool(_documents(inspection, root))


def check_cvat(inspection: Inspection, root: str) -> None:
    """Check each document, its boxes, and the images that it lists."""
    for name in _documents(inspection, root):
        _Document(inspection, name).check()
    if f"{root}labels.json" in inspection.folder.files:
        inspection.folder.json(f"{root}labels.json")


def _documents(inspection: Inspection, root: str) -> list[str]:
    below = inspection.folder.below(root, _NAME)
    return [name for name in below if name.rpartition("/")[2] == _NAME]


class _Document:
    """One document; images and boxes are checked as they come by."""

    def __init__(self, inspection: Inspection, name: str) -> None:
        self._inspection = inspection
        self._folder = inspection.folder
        self._name = name
        self._part: Part = inspection.part(name[: -len(_NAME)], "cvat")
        self._labels: list[str] = []
        self._ids: list[str] = []
        self._size: tuple[int, int] | None = None
        self._split = UNSPLIT
        self._where = ""
        self._label = ""
        self._video: list[str] = []
        self._texts: dict[str, str] = {}

    def check(self) -> None:
        """Check everything."""
        self._folder.named.add(self._name)
        try:
            read_elements(self._folder.path(self._name), self)
        except InputError as error:
            self._inspection.add("unreadable-file", self._name, error.what)
        self._inspection.check_unique(self._name, self._ids, "image id")
        self._inspection.check_unique(self._name, self._labels, "class")
        if self._labels:
            self._part.classes[self._name] = tuple(self._labels)

    def begins(self, path: tuple[str, ...], attributes: Mapping[str, str]) -> None:
        """Take the beginning of an element."""
        if path == ("annotations", "image"):
            self._begin_image(attributes)
        elif path == ("annotations", "track"):
            self._begin_track(attributes)
        elif path == ("annotations", "image", "box"):
            label = attributes.get("label", "")
            self._check_label(self._where, label)
            self._part.count_box(label, self._split)
            self._check_box(self._where, attributes)
        elif path == ("annotations", "track", "box"):
            self._track_box(attributes)

    def ends(self, path: tuple[str, ...], text: str) -> None:
        """Take the end of an element."""
        if path[-3:] == ("labels", "label", "name"):
            self._labels.append(text)
        elif path[-2:-1] == ("original_size",):
            self._texts[path[-1]] = text
        elif path == ("annotations", "meta"):
            self._end_meta()

    def _end_meta(self) -> None:
        """List the images of a video: those beside the document, in the order of their names."""
        if "width" not in self._texts:
            return
        self._size = _size(self._texts.get("width"), self._texts.get("height"))
        self._video = self._folder.below(f"{self._part.root}images/", *IMAGE_SUFFIXES)
        for image in self._video:
            self._inspection.list_image(self._part, image, UNSPLIT, self._name, size=self._size)

    def _begin_image(self, attributes: Mapping[str, str]) -> None:
        self._where = f"{self._name} image {attributes.get('id', '?')}"
        self._ids.append(attributes.get("id", ""))
        self._split = attributes.get("subset") or UNSPLIT
        self._size = _size(attributes.get("width"), attributes.get("height"))
        if self._size is None:
            self._inspection.add("malformed", self._where, "has no width and height above 0")
        file = self._locate(attributes.get("name"))
        if file is not None:
            self._inspection.list_image(self._part, file, self._split, self._where, size=self._size)

    def _locate(self, name: str | None) -> str | None:
        bases = [f"{self._part.root}images/{self._split}/", f"{self._part.root}images/"]
        bases.append(self._part.root)
        if self._folder.resolve("", self._split, self._where) is None:
            return None
        first = self._folder.resolve(bases[0], name, self._where)
        if first is None or name is None:
            return None
        return next((b + name for b in bases if b + name in self._folder.files), first)

    def _begin_track(self, attributes: Mapping[str, str]) -> None:
        self._where = f"{self._name} track {attributes.get('id', '?')}"
        self._label = attributes.get("label", "")
        self._check_label(self._where, self._label)

    def _track_box(self, attributes: Mapping[str, str]) -> None:
        frame = attributes.get("frame", "")
        where = f"{self._where} frame {frame}"
        if self._video and not (frame.isascii() and frame.isdecimal() and len(frame) < 10):
            self._inspection.add("bad-id", where, "the frame is no whole number from 0")
        elif self._video and int(frame) >= len(self._video):
            self._inspection.add("unknown-id", where, f"there are {len(self._video)} images")
        self._check_box(where, attributes)
        if attributes.get("outside") != "1":
            self._part.count_box(self._label, UNSPLIT)

    def _check_label(self, where: str, label: str) -> None:
        if self._labels and label not in self._labels:
            self._inspection.add("unknown-class", where, f"'{label}'")

    def _check_box(self, where: str, attributes: Mapping[str, str]) -> None:
        sides = [as_finite(attributes.get(side, "")) for side in _SIDES]
        self._inspection.check_box(where, sides, self._size)


def _size(width: str | None, height: str | None) -> tuple[int, int] | None:
    sides = as_finite(width or ""), as_finite(height or "")
    return (int(sides[0]), int(sides[1])) if min(sides) >= 1 else None
