"""COCO's JSON: files of instances, and files of results that name the images by number."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from percept.core.errors import InputError
from percept.core.labels import LabelSet
from percept.datasets.labels.boxes import BoxRows, as_box_id, as_number, as_track_id

__all__ = ["holds_coco_results", "read_coco", "read_coco_results"]

_LARGEST_FILE_BYTES = 1 << 30
_LARGEST_SIDE = 100_000
_MARK = b"\xef\xbb\xbf"  # which Windows puts at the beginning of UTF-8
_REMEDY = "Give a COCO file with images, annotations and categories, or a list of results"
_Size = tuple[int, int]


def holds_coco_results(path: Path) -> bool:
    """Return whether a JSON file begins as a list, which a file of results is.

    Raises:
        InputError: If the file cannot be read.
    """
    if not path.is_file():
        raise InputError("is no file", where=path, remedy=_REMEDY)
    try:
        with path.open("rb") as file:
            return file.read(64).removeprefix(_MARK).lstrip().startswith(b"[")
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error


def read_coco(path: Path, *, from_tool: bool = False) -> LabelSet:
    """Read a file of instances; `score` in the annotations becomes the confidence.

    Crowds (`iscrowd`) become ignored regions; `id` is the box's number, and `track_id`, also among
    `attributes`, its object's. Images are named by `file_name`, or by their number
    where there is none.

    Args:
        path: The JSON file.
        from_tool: Whether people edited it: `score`, which some boxes then have, is not read, and
            a file name that leads out of the data set is one that matches nothing.

    Raises:
        InputError: If the file is none of instances, or ids or names of images or categories come
            twice.
    """
    document = _load(path)
    if not isinstance(document, dict):
        raise InputError("holds no COCO instances", where=path, remedy=_REMEDY)
    dropped: Counter[str] = Counter()
    images = dict(_images(document, path, dropped, lenient=from_tool))
    categories = dict(_categories(document, path))
    rows = {number: BoxRows(path, dropped) for number in images}
    ids: Counter[object] = Counter()
    for entry in _entries(document, "annotations", path):
        ids[str(entry.get("id"))] += 1
        if from_tool:
            entry.pop("score", None)
        _add(entry, rows, categories, dropped)
    twice = sum(count > 1 for name, count in ids.items() if name != "None")
    return LabelSet(
        images=tuple(rows[number].image(one.name, one.size) for number, one in images.items()),
        categories=categories,
        image_ids={number: one.name for number, one in images.items()},
        dropped=dict(dropped),
        notes=(f"{twice} annotation ids come more than once",) if twice else (),
        files=(path,),
    )


def read_coco_results(path: Path, instances: LabelSet) -> LabelSet:
    """Read a file of results: a list of `image_id, category_id, bbox, score`.

    Args:
        path: The JSON file.
        instances: What `read_coco` gave for the file of instances that it was made for.

    Raises:
        InputError: If the file is no such list, or there are no instances to name its numbers.
    """
    if not instances.image_ids or not instances.categories:
        raise InputError(
            "is a COCO file of results, which gives images and classes as numbers",
            where=path,
            remedy="Give the COCO file of instances that it was made for as --labels",
        )
    document = _load(path)
    if not isinstance(document, list) or not all(isinstance(entry, dict) for entry in document):
        raise InputError("holds no list of COCO results", where=path, remedy=_REMEDY)
    dropped: Counter[str] = Counter()
    rows = {number: BoxRows(path, dropped) for number in instances.image_ids}
    for entry in document:
        _add(entry, rows, instances.categories, dropped, scored=True)
    sizes = {image.name: image.image_size for image in instances.images}
    return LabelSet(
        images=tuple(
            rows[number].image(name, sizes.get(name))
            for number, name in instances.image_ids.items()
        ),
        categories=instances.categories,
        image_ids=instances.image_ids,
        dropped=dict(dropped),
        files=(path,),
    )


@dataclass(frozen=True, slots=True)
class _Image:
    name: str
    size: _Size | None


def _load(path: Path) -> object:
    try:
        if path.stat().st_size > _LARGEST_FILE_BYTES:
            raise InputError("is larger than 1 GiB", where=path, remedy="Split it")
        with path.open("rb") as file:
            return json.load(file)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=path) from error
    except (ValueError, RecursionError) as error:  # numbers of 5,000 digits are ValueErrors too
        raise InputError(f"is not JSON ({error})", where=path) from error


def _entries(document: Mapping[str, object], key: str, path: Path) -> list[dict[str, Any]]:
    entries = document.get(key)
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"has no list '{key}'", where=path, remedy=_REMEDY)
    return entries


def _images(
    document: Mapping[str, object], path: Path, dropped: Counter[str], *, lenient: bool
) -> Iterator[tuple[int, _Image]]:
    numbers: set[int] = set()
    names: set[str] = set()
    for entry in _entries(document, "images", path):
        number = _id(entry.get("id"), "image", path)
        name = _name(entry.get("file_name", str(number)), path, lenient=lenient)
        if number in numbers or name in names:
            what = f"two images have the id {number} or the file name '{name}'"
            raise InputError(what, where=path, remedy="Give each image once")
        numbers.add(number)
        names.add(name)
        yield number, _Image(name, _size(entry, dropped))


def _categories(document: Mapping[str, object], path: Path) -> Iterator[tuple[int, str]]:
    numbers: set[int] = set()
    for entry in _entries(document, "categories", path):
        number, name = _id(entry.get("id"), "category", path), entry.get("name")
        if number in numbers:
            raise InputError(f"two categories have the id {number}", where=path)
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"category {number} has no name", where=path)
        numbers.add(number)
        yield number, name


def _id(value: object, kind: str, path: Path) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"'{str(value)[:40]}' is no id of an {kind}: a whole number", where=path)
    return value


def _name(value: object, path: Path, *, lenient: bool) -> str:
    """Return a file name below the data set, absolute ones without their root."""
    if not isinstance(value, str) or not value.strip():
        raise InputError("an image has no file name", where=path)
    name = PurePosixPath(PureWindowsPath(value).as_posix() if "\\" in value else value)
    if ".." in name.parts and lenient:
        return value
    if ".." in name.parts:
        raise InputError(f"the file name '{value[:80]}' leads out of the data set", where=path)
    return str(name.relative_to(name.anchor))


def _size(entry: Mapping[str, object], dropped: Counter[str]) -> _Size | None:
    width, height = (as_number(entry.get(key)) for key in ("width", "height"))
    if "width" not in entry and "height" not in entry:
        return None
    if not all(0 < side <= _LARGEST_SIDE and side == int(side) for side in (width, height)):
        dropped["image sizes that cannot be"] += 1
        return None
    return int(width), int(height)


def _add(
    entry: Mapping[str, object],
    rows: Mapping[int, BoxRows],
    categories: Mapping[int, str],
    dropped: Counter[str],
    *,
    scored: bool = False,
) -> None:
    """Add one annotation or result to its image, or count why not."""
    image, category, box = (entry.get(key) for key in ("image_id", "category_id", "bbox"))
    if not isinstance(image, int) or image not in rows:
        dropped["annotations of an image that is not listed"] += 1
        return
    if not isinstance(category, int) or category not in categories:
        dropped["annotations of a category that is not listed"] += 1
        return
    if not isinstance(box, list) or len(box) != 4:
        dropped["annotations without a box"] += 1
        return
    x, y, width, height = (as_number(value) for value in box)
    confidence = as_number(entry.get("score")) if scored or "score" in entry else None
    rows[image].add(
        categories[category],
        (x, y, x + width, y + height),
        confidence=confidence,
        ignore=as_number(entry.get("iscrowd")) == 1,
        box_id=0 if scored else as_box_id(entry.get("id")),
        track_id=as_track_id(_attribute(entry, "track_id")),
    )


def _attribute(entry: Mapping[str, object], name: str) -> object:
    """Return what an annotation says beyond COCO, by itself or in `attributes` as tools write."""
    attributes = entry.get("attributes")
    return entry.get(name, attributes.get(name) if isinstance(attributes, dict) else None)
