"""CVAT's XML, version 1.1: of images, and of video with tracks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

from percept.core.errors import InputError
from percept.core.labels import LabelSet
from percept.datasets.labels.boxes import BoxRows, as_box_id, as_track_id
from percept.datasets.labels.cvat_document import (
    CvatDocument,
    CvatImage,
    CvatShape,
    CvatTrack,
    read_document,
)

__all__ = ["cvat_files", "read_cvat"]

_FILE = "annotations.xml"
_NEW_TRACKS = 1 << 32
_MOST_BOXES = 5_000_000


def cvat_files(path: Path) -> tuple[Path, ...]:
    """Return the annotation files at a path: the file, that of a folder, or those of its videos."""
    if path.is_file():
        return (path,)
    for folder in (path, path / "images"):
        if (folder / _FILE).is_file():
            return (folder / _FILE,)
    return tuple(sorted([*path.glob(f"*/{_FILE}"), *path.glob(f"video/*/{_FILE}")]))


def read_cvat(path: Path) -> LabelSet:
    """Read a file, or those of several videos; an image of a video is named `<folder>/<number>`.

    The numbers of boxes and of their objects are the attributes `box_id` and `object_id`. Boxes
    that lie between two of a track's are interpolated, as CVAT shows them. Confidences are not
    read: what comes from CVAT are labels.

    Args:
        path: `annotations.xml` or a folder that holds it.

    Raises:
        InputError: If a file is none of CVAT's, or two images have one name.
    """
    files = cvat_files(path)
    if not files:
        raise InputError(
            f"holds no {_FILE}", where=path, remedy="Unpack what CVAT exported and name its folder"
        )
    dropped: Counter[str] = Counter()
    rows: dict[str, BoxRows] = {}
    sizes: dict[str, tuple[int, int] | None] = {}
    categories: dict[str, None] = {}
    for file in files:
        document = read_document(file)
        categories |= document.labels
        dropped.update(document.dropped)
        for image in (*document.images, *_frames(document, file.resolve().parent.name)):
            if image.name in rows:
                raise InputError(f"two images have the name '{image.name[:80]}'", where=file)
            sizes[image.name] = image.size
            rows[image.name] = BoxRows(file, dropped)
            for shape in image.shapes:
                _add(rows[image.name], shape)
    return LabelSet(
        images=tuple(boxes.image(name, sizes[name]) for name, boxes in rows.items()),
        categories=dict(enumerate(categories)),
        dropped=dict(dropped),
        files=files,
    )


def _add(rows: BoxRows, shape: CvatShape) -> None:
    attributes = shape.attributes
    rows.add(
        shape.label,
        shape.box_px,
        box_id=as_box_id(attributes.get("box_id")),
        track_id=as_track_id(attributes.get("object_id")),
    )


def _frames(document: CvatDocument, folder: str) -> Iterator[CvatImage]:
    """Yield the images of a video, by their numbers, with the boxes of all tracks."""
    if not document.tracks:
        return
    _name_objects(document)
    images = [
        CvatImage(f"{folder}/{number}", document.size, []) for number in range(document.frames)
    ]
    shown = chain.from_iterable(_shown(track, document.frames) for track in document.tracks)
    for count, (number, shape) in enumerate(shown):
        if count == _MOST_BOXES:
            raise InputError(f"shows more than {_MOST_BOXES:,} boxes", where=folder)
        images[number].shapes.append(shape)
    yield from images


def _name_objects(document: CvatDocument) -> None:
    """Make `object_id` a track's, and `box_id` that of one box only.

    A track that somebody drew has CVAT's number, put far above those of a data set; one in a
    single image says nothing of an object. What a box repeats is copied from the one before.
    """
    for track in document.tracks:
        shapes = sorted(track.shapes, key=lambda shape: shape.frame)
        number, shown = as_track_id(track.number), list(islice(_shown(track, document.frames), 2))
        named = any(as_track_id(s.attributes.get("object_id")) >= 0 for s in shapes)
        seen: set[str] = set()
        for shape in shapes:
            if not named:
                own = number + _NEW_TRACKS if number >= 0 and len(shown) > 1 else ""
                shape.attributes["object_id"] = str(own)
            if shape.attributes.get("box_id", "") in seen:
                del shape.attributes["box_id"]
            seen |= {shape.attributes.get("box_id", "")} - {""}


def _shown(track: CvatTrack, frames: int) -> Iterator[tuple[int, CvatShape]]:
    """Yield the boxes of a track in each image that shows it.

    A box stays where it is after the last one that was drawn, until it is `outside`.
    """
    shapes = sorted(track.shapes, key=lambda shape: shape.frame)
    for shape, after in zip(shapes, [*shapes[1:], None], strict=True):
        end = frames if after is None else after.frame
        for number in range(shape.frame, min(end, frames)):
            if shape.outside:
                break
            yield number, shape if after is None else _between(shape, after, number)


def _between(shape: CvatShape, after: CvatShape, number: int) -> CvatShape:
    """Return the box at a number from that of one drawn box to that of the next."""
    if number == shape.frame or after.outside:
        return shape
    share = (number - shape.frame) / (after.frame - shape.frame)
    sides = zip(shape.box_px, after.box_px, strict=True)
    x1, y1, x2, y2 = (a + share * (b - a) for a, b in sides)
    attributes = {name: text for name, text in shape.attributes.items() if name != "box_id"}
    return replace(shape, box_px=(x1, y1, x2, y2), frame=number, attributes=attributes)
