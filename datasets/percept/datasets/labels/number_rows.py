"""Text files with one box a line, read line by line so that an error can name its line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError

__all__ = ["as_numbers", "as_whole", "frame_order", "text_rows"]

_LARGEST = 2**53  # above it not every whole number is a float


def text_rows(path: Path, separator: str | None = None) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that are not empty: number from 1, and their parts.

    Args:
        path: The file.
        separator: What stands between the parts; None is white space.

    Raises:
        InputError: If the file cannot be read as text.
    """
    try:
        with path.open(encoding="utf-8-sig") as lines:
            for number, line in enumerate(lines, 1):
                if line.strip():
                    yield number, line.strip().split(separator)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", where=path) from error


def as_numbers(words: Sequence[str], path: Path, line: int) -> list[float]:
    """Return words as finite numbers.

    Raises:
        InputError: If one is none; it names the file and the line.
    """
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"line {line}: {error}", where=path) from error
    if not all(map(math.isfinite, values)):
        raise InputError(f"line {line}: a number is not finite", where=path)
    return values


def as_whole(word: str, name: str, path: Path, line: int) -> int:
    """Return a word as whole number; `3.0` is one too.

    Raises:
        InputError: If it is none; it names the file and the line.
    """
    value = as_numbers([word], path, line)[0]
    if not value.is_integer() or abs(value) > _LARGEST:
        raise InputError(f"line {line}: {name} '{word[:20]}' is no whole number", where=path)
    return int(value)


def frame_order(
    frames: Sequence[int], ids: Sequence[int], lines: Sequence[int], path: Path
) -> NDArray[np.intp]:
    """Return the order of rows that brings frames in order and keeps that of the file in each.

    Args:
        frames: Frame of each row.
        ids: Identity of each row; negative ones may repeat.
        lines: Line of each row, for errors.
        path: The file, for errors.

    Raises:
        InputError: If an identity comes twice in a frame; it names the second line.
    """
    seen: set[tuple[int, int]] = set()
    for frame, name, line in zip(frames, ids, lines, strict=True):
        if name >= 0 and (frame, name) in seen:
            raise InputError(f"line {line}: id {name} comes twice in frame {frame}", where=path)
        seen.add((frame, name))
    return np.argsort(np.array(frames, np.int64), kind="stable")
