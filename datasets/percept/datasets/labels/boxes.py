"""Gathers the boxes of an image from a file that may say anything."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

from percept.core.errors import InputError
from percept.core.labels import LabelledImage

__all__ = ["BoxRows", "as_box_id", "as_number", "as_track_id", "read_text_lines"]

_LARGEST_PX = 1e6
_LARGEST_FILE_BYTES = 16 * 1024 * 1024
_ROUNDING = 1e-6
_LARGEST_ID = 2**53  # the largest that every program keeps
_LONGEST_ID = 16
_NO_TRACK = -1


class BoxRows:
    """The boxes of one image; those that cannot be a box are counted and left out.

    Args:
        where: File that they are in, for errors.
        dropped: Counts what is left out, by reason.
    """

    def __init__(self, where: object, dropped: Counter[str]) -> None:
        self._where = where
        self._dropped = dropped
        self._boxes: list[tuple[float, float, float, float]] = []
        self._labels: list[str] = []
        self._confidences: list[float | None] = []
        self._ignore: list[bool] = []
        self._range_m: list[float] = []
        self._visible: list[float] = []
        self._box_ids: list[int] = []
        self._track_ids: list[int] = []

    def add(
        self,
        label: str,
        box_px: tuple[float, float, float, float],
        *,
        confidence: float | None = None,
        ignore: bool = False,
        range_m: float = math.nan,
        visible: float = math.nan,
        box_id: int = 0,
        track_id: int = _NO_TRACK,
    ) -> None:
        """Add a box x1, y1, x2, y2; its number is 0, and its track -1, where it has none.

        Raises:
            InputError: If a confidence is finite and not in 0..1.
        """
        reason = _unusable(box_px, confidence)
        if reason is not None:
            self._dropped[reason] += 1
            return
        if confidence is not None:
            confidence = self._checked(confidence)
        self._boxes.append(box_px)
        self._labels.append(label)
        self._confidences.append(confidence)
        self._ignore.append(ignore)
        self._range_m.append(range_m if 0 <= range_m < math.inf else math.nan)
        self._visible.append(visible)
        self._box_ids.append(box_id)
        self._track_ids.append(track_id)

    def image(self, name: str, image_size: tuple[int, int] | None = None) -> LabelledImage:
        """Return the image with its boxes.

        Raises:
            InputError: If some boxes have a confidence and others do not.
        """
        known = [c for c in self._confidences if c is not None]
        if known and len(known) < len(self._confidences):
            raise InputError("some boxes have a confidence and others do not", where=self._where)
        return LabelledImage.of(
            name,
            self._boxes,
            self._labels,
            known or None,
            image_size=image_size,
            ignore=self._ignore,
            range_m=self._range_m,
            visible=self._visible,
            box_ids=self._box_ids,
            track_ids=self._track_ids,
        )

    def _checked(self, confidence: float) -> float:
        if not -_ROUNDING <= confidence <= 1 + _ROUNDING:
            raise InputError(
                f"a confidence of {confidence:g} is not in 0..1",
                where=self._where,
                remedy="Bring the scores to 0..1",
            )
        return min(max(confidence, 0.0), 1.0)


def _unusable(box_px: tuple[float, float, float, float], confidence: float | None) -> str | None:
    x1, y1, x2, y2 = box_px
    if not all(map(math.isfinite, box_px)) or (
        confidence is not None and not math.isfinite(confidence)
    ):
        return "boxes that are not finite"
    if x2 <= x1 or y2 <= y1:
        return "boxes of negative or no size"
    if max(map(abs, box_px)) > _LARGEST_PX:
        return "boxes beyond a million pixels"
    return None


def as_number(value: object) -> float:
    """Return a number of a JSON file or a table as float; NaN for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def as_box_id(value: object) -> int:
    """Return the number of a box, given as a number or its digits; 0 for what is none."""
    number = _whole(value)
    return number if number is not None and number > 0 else 0


def as_track_id(value: object) -> int:
    """Return the number of a track, given as a number or its digits; -1 for what is none."""
    number = _whole(value)
    return number if number is not None and number >= 0 else _NO_TRACK


def _whole(value: object) -> int | None:
    if isinstance(value, str) and len(value) <= _LONGEST_ID and value.isascii():
        value = int(value) if value.isdecimal() else None
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > _LARGEST_ID:
        return None
    return value


def read_text_lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return the lines of a text file that are not empty: number from 1, and words.

    Raises:
        InputError: If the file is too large for labels, or no text.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE_BYTES:
            raise InputError("too large for the labels of one image", where=path)
        text = path.read_text(encoding="utf-8-sig")  # Windows begins files with a mark
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot be read ({error})", where=path) from error
    lines = ((number, line.split()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, words) for number, words in lines if words]
