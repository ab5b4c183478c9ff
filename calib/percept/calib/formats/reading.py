"""Reading strangers' files: bounded, without surprises, with one-line errors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from percept.core.errors import InputError

__all__ = ["camera_matrix", "image_size", "matrix", "number_list", "read_text", "yaml_mapping"]

_LARGEST_BYTES = 4 * 1024 * 1024
_LARGEST_SIDE_PX = 100_000
_MOST_NUMBERS = 1000
_DEEPEST = 8


def read_text(path: Path) -> str:
    """Return the text of a small file.

    Raises:
        InputError: If it is missing, too large or no text.
    """
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise InputError("is too large for a calibration file", where=path)
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise InputError(f"cannot be read ({reason})", where=path) from error


def yaml_mapping(text: str, path: Path) -> dict[str, Any]:
    """Return the first document of a YAML text, which must be a mapping.

    Raises:
        InputError: If it is no YAML mapping.
    """
    # `ros2 topic echo` ends each message with a document mark.
    first = re.split(r"^---\s*$", re.sub(r"\A---\s*\n", "", text), maxsplit=1, flags=re.MULTILINE)
    try:
        values = yaml.safe_load(first[0])
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"is not YAML ({reason})", where=path) from error
    if not isinstance(values, dict):
        raise InputError("holds no calibration that percept knows", where=path)
    return {str(key): value for key, value in values.items()}


def number_list(value: object, count: int | None, what: str, path: Path) -> list[float]:
    """Return a list of finite numbers, in nested lists or a mapping with `data` too.

    Args:
        value: What the file holds.
        count: How many there must be, or None.
        what: Its name in the file.
        path: The file.

    Raises:
        InputError: If they are no finite numbers or there are not so many.
    """
    inner = value.get("data") if isinstance(value, Mapping) else value
    # A YAML file of a few lines can name lists of lists without end.
    flat = [] if inner is None else list(islice(_flattened(inner), _MOST_NUMBERS + 1))
    if len(flat) > _MOST_NUMBERS:
        raise InputError(f"'{what}' holds far too many numbers", where=path)
    plain = [float(v) for v in flat if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(plain) != len(flat) or not all(map(math.isfinite, plain)):
        raise InputError(f"'{what}' holds something that is no finite number", where=path)
    if count is not None and len(plain) != count:
        raise InputError(f"'{what}' needs {count} numbers and has {len(plain)}", where=path)
    return plain


def matrix(value: object, what: str, path: Path) -> NDArray[np.float64]:
    """Return a (4, 4) rigid transform, whose rounded rotation is made exact.

    Raises:
        InputError: If it is none.
    """
    given = np.array(number_list(value, 16, what, path)).reshape(4, 4)
    turn, _, other = np.linalg.svd(given[:3, :3])
    exact = turn @ other
    off = float(np.abs(exact - given[:3, :3]).max())
    if off > 1e-3 or np.linalg.det(exact) < 0 or not np.allclose(given[3], [0, 0, 0, 1]):
        raise InputError(f"'{what}' is no rigid transform", where=path)
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = exact, given[:3, 3]
    return rigid


def camera_matrix(value: object, what: str, path: Path) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy of a (3, 3) camera matrix.

    Raises:
        InputError: If it is no camera matrix, or has a skew.
    """
    fx, skew, cx, zero, fy, cy, *last = number_list(value, 9, what, path)
    if last != [0.0, 0.0, 1.0] or zero or fx <= 0 or fy <= 0:
        raise InputError(f"'{what}' is no camera matrix", where=path)
    if abs(skew) > 1e-9:
        raise InputError(f"'{what}' has a skew, which percept's cameras have not", where=path)
    return fx, fy, cx, cy


def image_size(width: object, height: object, path: Path) -> tuple[int, int]:
    """Return the size of an image.

    Raises:
        InputError: If it is missing or no size.
    """
    sides = []
    for side in (width, height):
        if not isinstance(side, int | float) or not 1 <= side <= _LARGEST_SIDE_PX:
            raise InputError("says no image size (width and height in pixels)", where=path)
        sides.append(int(side))
    return sides[0], sides[1]


def _flattened(value: object, depth: int = 0) -> Iterator[object]:
    if isinstance(value, Sequence) and not isinstance(value, str) and depth < _DEEPEST:
        for part in value:
            yield from _flattened(part, depth + 1)
    else:
        yield value
