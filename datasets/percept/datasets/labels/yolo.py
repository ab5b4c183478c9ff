"""YOLO's label files: one an image, a line a box, in shares of the image's size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from percept.core.errors import ConfigError, InputError
from percept.core.labels import LabelSet
from percept.core.settings import load_yaml_mapping
from percept.datasets.labels.boxes import BoxRows, read_text_lines
from percept.datasets.labels.image_size import image_file_size

__all__ = ["looks_like_yolo", "read_yolo", "yolo_class_names"]

_Size = tuple[int, int]
_NAME_FILES = ("data.yaml", "dataset.yaml", "classes.txt")
_IMAGE_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp"}
_LEVELS_ABOVE = 3
_FARTHEST_SHARE = 1.5  # beyond this a value is no share of an image that was rounded or clipped


def looks_like_yolo(words: list[str]) -> bool:
    """Return whether a line can be one of a YOLO label file: a class number and its box."""
    return len(words) in (5, 6) and words[0].isdecimal()


def yolo_class_names(path: Path) -> dict[int, str] | None:
    """Return the class names by number from a file at or above a folder; None without one.

    Raises:
        InputError: If the file is there and holds no class names.
    """
    for folder in (path, *path.parents[: _LEVELS_ABOVE - 1]):
        for name in _NAME_FILES:
            if (folder / name).is_file():
                return _names_of(folder / name)
    return None


def read_yolo(
    path: Path,
    *,
    class_names: Mapping[int, str] | None = None,
    image_size: _Size | None = None,
    size_of: Callable[[str], _Size | None] = lambda _name: None,
) -> LabelSet:
    """Read label files: `class cx cy w h`, and the confidence where a detector wrote it.

    The size of an image comes from the header of its file in `images/` beside `labels/` (or in
    the same folder), else from the arguments. An image without a label file has no boxes.

    Args:
        path: The folder of a data set, its `labels/`, or a folder below.
        class_names: By number, where no `data.yaml` or `classes.txt` is at or above the files.
        image_size: (width, height) of all images that are not there.
        size_of: Gives the size of an image by its name, or None.

    Raises:
        InputError: If a line is no box, a class has no name, or the size of an image is unknown.
    """
    labels, images = _folders(path)
    names = yolo_class_names(path) or class_names
    if names is None:
        raise InputError(
            "has no class names", where=path, remedy="Put data.yaml or classes.txt beside labels/"
        )
    files, pictures = _named(labels, {".txt"}), _named(images, _IMAGE_SUFFIXES)
    if not files and not pictures:
        raise InputError("holds no label files (*.txt)", where=path)
    dropped: Counter[str] = Counter()
    found = []
    for name in sorted({*files, *pictures}):
        size = image_file_size(pictures[name]) if name in pictures else None
        size = size or size_of(name) or image_size
        rows = BoxRows(files.get(name, path), dropped)
        if name in files:
            _add_lines(rows, files[name], size, names)
        found.append(rows.image(name, size))
    return LabelSet(
        images=tuple(found),
        categories=dict(names),
        dropped=dict(dropped),
        files=tuple(files.values()),
    )


def _folders(path: Path) -> tuple[Path, Path]:
    """Return the folder of labels, and that of the images with the same names."""
    if (path / "labels").is_dir():
        path = path / "labels"
    above = next((p for p in (path, *path.parents) if p.name == "labels"), None)
    if above is None:
        return path, path
    images = above.parent / "images" / path.relative_to(above)
    return path, images if images.is_dir() else path


def _named(root: Path, suffixes: Collection[str]) -> dict[str, Path]:
    """Return the files below a folder by their names without suffix."""
    return {
        file.relative_to(root).with_suffix("").as_posix(): file
        for file in sorted(root.rglob("*"))
        if file.suffix.lower() in suffixes and file.is_file() and file.name not in _NAME_FILES
    }


def _add_lines(rows: BoxRows, file: Path, size: _Size | None, names: Mapping[int, str]) -> None:
    for line, words in read_text_lines(file):
        if not looks_like_yolo(words):
            raise InputError(
                f"line {line} has {len(words)} columns beginning with '{words[0][:20]}'; a box is "
                "a class number and cx cy w h, and a confidence where a detector wrote it",
                where=file,
                remedy="Polygons, oriented boxes and key points are not read",
            )
        values = _values(words, file, line)
        if int(words[0]) not in names:
            raise InputError(
                f"line {line} has class {words[0]}, and there are names of {len(names)} classes",
                where=file,
            )
        if size is None:
            raise InputError(
                "the size of the image is not known",
                where=file,
                remedy="Put the image into images/ beside labels/, or pass --image-size WxH",
            )
        cx, cy, w, h = (
            value * side for value, side in zip(values[:4], (*size, *size), strict=True)
        )
        rows.add(
            names[int(words[0])],
            (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2),
            confidence=values[4] if len(values) == 5 else None,
        )


def _values(words: list[str], file: Path, line: int) -> list[float]:
    try:
        values = [float(word) for word in words[1:]]
    except ValueError as error:
        raise InputError(f"line {line}: {error}", where=file) from error
    if any(abs(value) > _FARTHEST_SHARE for value in values[:4]):
        raise InputError(
            f"line {line} is in pixels; YOLO labels are shares of the image's size, 0..1",
            where=file,
        )
    return values


def _names_of(path: Path) -> dict[int, str]:
    if path.suffix == ".txt":
        return _names_by_line(path)
    try:
        content: Any = load_yaml_mapping(path).get("names")
    except ConfigError as error:
        raise InputError(error.what, where=path) from error
    pairs = dict(enumerate(content)) if isinstance(content, list) else content
    if not isinstance(pairs, dict) or not pairs:
        raise InputError("has no 'names' of classes", where=path)
    if not all(isinstance(k, int) and isinstance(name, str) for k, name in pairs.items()):
        raise InputError("'names' must be texts, in a list or by number", where=path)
    return pairs


def _names_by_line(path: Path) -> dict[int, str]:
    lines = read_text_lines(path)
    if not lines or lines[-1][0] != len(lines):
        raise InputError(
            "has empty lines between the class names: which number each has is not clear"
            if lines
            else "has no class names",
            where=path,
        )
    return {number - 1: " ".join(words) for number, words in lines}
