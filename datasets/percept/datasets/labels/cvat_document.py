"""What stands in a file of CVAT's XML, before tracks are spread over images."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from percept.core.errors import InputError
from percept.datasets.labels.xml_events import read_elements

__all__ = ["CvatDocument", "CvatImage", "CvatShape", "CvatTrack", "read_document"]

_LARGEST_SIDE = 100_000
_MOST_FRAMES = 200_000
_MOST_DIGITS = 9
_SHAPES = {
    "box", "polygon", "polyline", "points", "ellipse", "cuboid", "mask", "skeleton", "tag",
}  # fmt: skip
_REMEDY = "Export the task as 'CVAT for images 1.1' or 'CVAT for video 1.1'"


@dataclass(slots=True)
class CvatShape:
    """A box: `frame` and `outside` are those of a track; attributes by their names."""

    label: str
    box_px: tuple[float, float, float, float]
    frame: int
    outside: bool
    attributes: dict[str, str]


@dataclass(slots=True)
class CvatImage:
    """An image and its boxes."""

    name: str
    size: tuple[int, int] | None
    shapes: list[CvatShape]


@dataclass(slots=True)
class CvatTrack:
    """An object over the images of a video: its number, class, and the boxes that were drawn."""

    number: str
    label: str
    shapes: list[CvatShape]


@dataclass(slots=True)
class CvatDocument:
    """The content of a file.

    Attributes:
        labels: The classes that the task lists, in their order.
        images: Of a task of images.
        tracks: Of a video.
        frames: Number of images of the video.
        size: (width, height) of the video; None where it is not said.
        dropped: Shapes that are no boxes, counted by what they are.
    """

    labels: dict[str, None] = field(default_factory=dict)
    images: list[CvatImage] = field(default_factory=list)
    tracks: list[CvatTrack] = field(default_factory=list)
    frames: int = 0
    size: tuple[int, int] | None = None
    dropped: Counter[str] = field(default_factory=Counter)


def read_document(file: Path) -> CvatDocument:
    """Read a file.

    Raises:
        InputError: If it is no XML, has a document type, or is none of CVAT's.
    """
    reader = _Reader(file)
    read_elements(file, reader)
    return reader.finished()


class _Reader:
    def __init__(self, file: Path) -> None:
        self._file = file
        self._found = CvatDocument()
        self._shape: CvatShape | None = None
        self._attribute = ""
        self._sides: dict[str, str] = {}
        self._stated_frames = 0
        self._last_frame = -1

    def begins(self, path: tuple[str, ...], attributes: Mapping[str, str]) -> None:
        if path[0] != "annotations":
            raise InputError(f"holds <{path[0][:40]}>, not CVAT's annotations", where=self._file)
        match path[1:]:
            case ("image",):
                size = _size(attributes.get("width"), attributes.get("height"))
                name = attributes.get("name", "")
                self._found.images.append(CvatImage(name, size, []))
            case ("track",):
                track = CvatTrack(attributes.get("id", ""), attributes.get("label", ""), [])
                self._found.tracks.append(track)
            case ("image" | "track", str() as kind) if kind in _SHAPES:
                self._begin_shape(path[1], kind, attributes)
            case ("image" | "track", "box", "attribute"):
                self._attribute = attributes.get("name", "")

    def ends(self, path: tuple[str, ...], text: str) -> None:
        match path[1:]:
            case ("image" | "track", "box", "attribute"):
                if self._shape is not None:
                    self._shape.attributes[self._attribute] = text
            case ("image" | "track", "box"):
                self._shape = None
            case ("meta", "task" | "job" | "project", "labels", "label", "name"):
                self._found.labels[text] = None
            case ("meta", "task" | "job", "size"):
                self._stated_frames = self._whole(text, "size")
            case ("meta", *_, "original_size", "width" | "height" as side):
                self._sides[side] = text

    def finished(self) -> CvatDocument:
        found = self._found
        # A video without a box has no tracks, and its images are still looked at.
        found.frames = max(self._stated_frames, self._last_frame + 1)
        if found.frames > _MOST_FRAMES:
            raise InputError(
                f"has {found.frames:,} images; {_MOST_FRAMES:,} is most", where=self._file
            )
        found.size = _size(self._sides.get("width"), self._sides.get("height"))
        if any(not image.name for image in found.images):
            raise InputError("has an image without a name", where=self._file, remedy=_REMEDY)
        return found

    def _begin_shape(self, owner: str, kind: str, attributes: Mapping[str, str]) -> None:
        found = self._found
        frame = 0 if owner == "image" else self._whole(attributes.get("frame", ""), "frame")
        self._last_frame = max(self._last_frame, frame)
        if kind != "box" or _number(attributes.get("rotation", "0")) != 0:
            found.dropped["turned boxes" if kind == "box" else f"shapes of kind {kind}"] += 1
            return
        of = found.images[-1] if owner == "image" else found.tracks[-1]
        label = of.label if isinstance(of, CvatTrack) else attributes.get("label", "")
        if not label:
            raise InputError("has a box without a label", where=self._file, remedy=_REMEDY)
        x1, y1, x2, y2 = (_number(attributes.get(k, "")) for k in ("xtl", "ytl", "xbr", "ybr"))
        is_outside = attributes.get("outside") == "1"
        self._shape = CvatShape(label, (x1, y1, x2, y2), frame, is_outside, {})
        of.shapes.append(self._shape)

    def _whole(self, text: str, name: str) -> int:
        if not text.isascii() or not text.isdecimal() or len(text) > _MOST_DIGITS:
            raise InputError(f"'{text[:40]}' is no number as {name}", where=self._file)
        return int(text)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _size(width: str | None, height: str | None) -> tuple[int, int] | None:
    sides = _number(width or ""), _number(height or "")
    if not all(0 < side <= _LARGEST_SIDE and side.is_integer() for side in sides):
        return None
    return int(sides[0]), int(sides[1])
