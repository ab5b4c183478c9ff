"""KITTI's label files: one an image, a line an object, in pixels; results have a score too."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from percept.core.errors import InputError
from percept.core.labels import ANY_LABEL, LabelledImage, LabelSet
from percept.datasets.labels.boxes import BoxRows, read_text_lines

__all__ = ["kitti_folder", "kitti_objects", "looks_like_kitti", "read_kitti"]

_COLUMNS = 15
_DONT_CARE = "DontCare"
_UNKNOWN_M = -999.0  # -1000 stands for an unknown place
_PLACES = ("label_2", "training/label_2", "data")


def kitti_folder(path: Path) -> Path:
    """Return the folder of label files at or below a path, as the benchmark lays it out."""
    return next((path / place for place in _PLACES if (path / place).is_dir()), path)


def looks_like_kitti(words: list[str]) -> bool:
    """Return whether a line can be one of a KITTI label file."""
    return len(words) in (_COLUMNS, _COLUMNS + 1) and not _is_number(words[0])


def read_kitti(path: Path) -> LabelSet:
    """Read label files; `DontCare` becomes an ignored region of any class.

    Images are named by their file. The distance is that in the plane of the ground, from x and z
    of the object's place in the camera's frame.

    Args:
        path: Folder of `*.txt` files, or one above it.

    Raises:
        InputError: If there are no files, or a line is none of KITTI's.
    """
    folder = kitti_folder(path)
    files = sorted(folder.glob("*.txt"))
    if not files:
        raise InputError("holds no label files (*.txt)", where=folder)
    dropped: Counter[str] = Counter()
    images = tuple(_read_file(file, dropped) for file in files)
    return LabelSet(images, dropped=dict(dropped), files=tuple(files))


def kitti_objects(file: Path) -> list[tuple[str, list[float]]]:
    """Return the objects of a label file: class, and the 14 numbers or 15 with a score after it.

    Raises:
        InputError: If the file cannot be read, or a line is none of KITTI's.
    """
    found = []
    for number, words in read_text_lines(file):
        if not looks_like_kitti(words):
            raise InputError(
                f"line {number} has {len(words)} columns beginning with '{words[0][:20]}'; a KITTI "
                f"label has a class and {_COLUMNS - 1} numbers, and a result a score",
                where=file,
            )
        try:
            found.append((words[0], [float(word) for word in words[1:]]))
        except ValueError as error:
            raise InputError(f"line {number}: {error}", where=file) from error
    return found


def _read_file(file: Path, dropped: Counter[str]) -> LabelledImage:
    rows = BoxRows(file, dropped)
    for label, values in kitti_objects(file):
        _add(rows, label, values)
    return rows.image(file.stem)


def _add(rows: BoxRows, label: str, values: list[float]) -> None:
    x1, y1, x2, y2 = values[3:7]
    x_m, z_m = values[10], values[12]
    ignored = label == _DONT_CARE
    rows.add(
        ANY_LABEL if ignored else label,
        (x1, y1, x2, y2),
        confidence=values[14] if len(values) == _COLUMNS else None,
        ignore=ignored,
        range_m=math.hypot(x_m, z_m) if min(x_m, z_m) > _UNKNOWN_M else math.nan,
    )


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
