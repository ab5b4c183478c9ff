"""What all drawn pictures share: colours, text, legends, bars, and how large they come out.

Pictures are (H, W, 3) uint8 BGR on a dark ground; colours are given as red, green, blue.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.export.palette import sequential_colours

__all__ = [
    "BACKGROUND",
    "FIXED_SHIFT",
    "QUIET",
    "TEXT",
    "Image",
    "Rgb",
    "as_bgr",
    "blank",
    "draw_scale_bar",
    "fitting_scale",
    "fixed_point",
    "resized",
    "round_length",
    "round_limit",
    "text_width",
    "with_colour_bar",
    "with_header",
    "write_text",
]

Image = NDArray[np.uint8]
Rgb = tuple[int, int, int]

BACKGROUND: Rgb = (20, 24, 28)
TEXT: Rgb = (228, 232, 236)
QUIET: Rgb = (160, 171, 182)
FIXED_SHIFT = 4  # OpenCV draws at 1/16 pixel with it

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_FONT_SCALE = 0.42
_TITLE_SCALE = 0.55
_LARGEST_PX = 1200
_SMALLEST_PX = 640
_LEAST_WIDTH_PX = 320
_LONGEST_NAME = 40
_BAR_PX = 12
_RIM = tuple((x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y)
_STEPS = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)


def blank(width: int, height: int) -> Image:
    """Return an empty picture."""
    return np.full((max(height, 1), max(width, 1), 3), BACKGROUND[::-1], np.uint8)


def as_bgr(pixels: NDArray[np.generic]) -> Image:
    """Return an image (H, W) or (H, W, 3) of any depth as BGR of 8 bits.

    Deeper images are stretched over what they hold.

    Raises:
        GeometryError: If it has another shape, or no pixels.
    """
    shape = np.shape(pixels)
    if len(shape) not in (2, 3) or shape[2:] not in ((), (1,), (3,)) or 0 in shape:
        raise GeometryError(f"{shape} is no image")
    values = np.asarray(pixels)
    if values.dtype != np.uint8:
        numbers = np.nan_to_num(values.astype(np.float64), posinf=0.0, neginf=0.0)
        low, high = float(numbers.min()), float(numbers.max())
        values = ((numbers - low) * (255 / max(high - low, 1e-12))).astype(np.uint8)
    if values.ndim == 2 or shape[2:] == (1,):
        return np.repeat(values.reshape(*shape[:2], 1), 3, axis=2)
    return np.ascontiguousarray(values, dtype=np.uint8)


def fitting_scale(width: int, height: int) -> float:
    """Return how much an image has to grow or shrink to be legible on a page."""
    longest = max(width, height, 1)
    return min(1.0, _LARGEST_PX / longest) if longest >= _SMALLEST_PX else _SMALLEST_PX / longest


def resized(pixels: Image, scale: float) -> Image:
    """Return an image grown or shrunk by a factor, at least one pixel large."""
    height, width = pixels.shape[:2]
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(pixels, size, interpolation=how), dtype=np.uint8)


def fixed_point(pixels: NDArray[np.floating]) -> NDArray[np.int32]:
    """Return pixels in the fixed-point numbers that OpenCV draws with `FIXED_SHIFT`.

    What lies far outside of every picture is drawn at its edge: OpenCV's numbers are short.
    """
    bounded = np.clip(pixels, -20_000.0, 20_000.0)
    fixed: NDArray[np.int32] = np.rint(bounded * 2**FIXED_SHIFT).astype(np.int32)
    return fixed


def round_length(value: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is at least the value."""
    if not math.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next((f * power for f in (1, 2, 5) if f * power >= value * (1 - 1e-9)), 10 * power)


def round_limit(value: float) -> float:
    """Return a number that is at least the value and that five parts divide into round ones."""
    if not math.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value / 5))
    return next(5 * f * power for f in _STEPS if 5 * f * power >= value * (1 - 1e-9))


def text_width(text: str, *, scale: float = _FONT_SCALE) -> int:
    """Return the width of a text in pixels."""
    return int(cv2.getTextSize(_ascii(text), _FONT, scale, 1)[0][0])


def write_text(
    image: Image, text: str, at: tuple[int, int], colour: Rgb = TEXT, *, scale: float = _FONT_SCALE
) -> None:
    """Write a text with a dark rim, so that it can be read on points.

    Args:
        image: The picture; it is changed.
        text: The text; letters that OpenCV cannot draw become question marks.
        at: Left end of the base line, (column, row).
        colour: Of the letters.
        scale: Size of the letters.
    """
    letters = _ascii(text)
    # A thick copy below would do with OpenCV 4, but the letters of 5 keep their outline.
    for shift in _RIM:
        around = at[0] + shift[0], at[1] + shift[1]
        cv2.putText(image, letters, around, _FONT, scale, BACKGROUND[::-1], 1, cv2.LINE_AA)
    cv2.putText(image, letters, at, _FONT, scale, colour[::-1], 1, cv2.LINE_AA)


def draw_scale_bar(image: Image, px_per_unit: float, unit: str = "m") -> None:
    """Draw a bar of a round length, about a fifth of the picture wide, in its lower left."""
    height, width = image.shape[:2]
    length = round_length(width / 5 / px_per_unit / 1.6)
    row, right = height - 18, 16 + round(length * px_per_unit)
    ends = np.array([[16, row - 5], [16, row], [right, row], [right, row - 5]], np.int32)
    cv2.polylines(image, [ends], isClosed=False, color=BACKGROUND[::-1], thickness=5)
    cv2.polylines(image, [ends], isClosed=False, color=TEXT[::-1], thickness=2)
    write_text(image, f"{length:g} {unit}", (right + 8, row + 3))


def with_header(picture: Image, title: str, legend: Sequence[tuple[str, Rgb]] = ()) -> Image:
    """Return a picture with its title and a legend above it.

    Args:
        picture: The picture.
        title: What is shown; nothing is drawn for an empty one.
        legend: What each colour means.
    """
    if not title and not legend:
        return picture
    width = max(picture.shape[1], _LEAST_WIDTH_PX)
    rows = _wrapped([(_shortened(text), colour) for text, colour in legend], width)
    top = 30 if title else 8
    header = blank(width, top + 20 * len(rows) + 2)
    if title:
        wide = text_width(title, scale=_TITLE_SCALE)
        scale = max(_FONT_SCALE, _TITLE_SCALE * min(1.0, (width - 24) / max(wide, 1)))
        write_text(header, title, (12, 21), scale=scale)
    for line, row in enumerate(rows):
        for x, text, colour in row:
            y = top + 20 * line
            cv2.rectangle(header, (x, y), (x + 11, y + 11), colour[::-1], -1)
            write_text(header, text, (x + 18, y + 10))
    return _stacked(header, picture)


def with_colour_bar(
    picture: Image, low: float, high: float, unit: str, *, beyond: str = "", parts: int = 5
) -> Image:
    """Return a picture with the bar of `sequential_colours` below it.

    Args:
        picture: The picture.
        low: Value of the first colour.
        high: Value of the last one.
        unit: Unit of both.
        beyond: What stands behind the last value, such as ` and more`.
        parts: Parts between the numbers.
    """
    width = max(picture.shape[1], _LEAST_WIDTH_PX)
    bar = blank(width, 40)
    left, length = 24, max(width - 150, 120)
    colours = sequential_colours(np.linspace(0, 1, length))[:, ::-1]
    bar[8 : 8 + _BAR_PX, left : left + length] = colours[: width - left]
    for part in range(parts + 1):
        text = f"{low + (high - low) * part / parts:.4g}"
        if part == parts:
            text += f" {unit}{beyond}"
        at = left + round((length - 1) * part / parts)
        cv2.line(bar, (at, 8), (at, 8 + _BAR_PX + 2), TEXT[::-1], 1)
        write_text(bar, text, (at - 8, 35), QUIET)
    return _stacked(picture, bar)


def _wrapped(legend: Sequence[tuple[str, Rgb]], width: int) -> list[list[tuple[int, str, Rgb]]]:
    """Return the lines of a legend: of each entry its column, text and colour."""
    rows: list[list[tuple[int, str, Rgb]]] = []
    x = width
    for text, colour in legend:
        wide = 18 + text_width(text) + 18
        if not rows or x + wide > width:
            rows.append([])
            x = 12
        rows[-1].append((x, text, colour))
        x += wide
    return rows


def _stacked(upper: Image, lower: Image) -> Image:
    """Return two pictures above each other, the narrower one in the middle."""
    width = max(upper.shape[1], lower.shape[1])
    parts = []
    for part in (upper, lower):
        row = blank(width, part.shape[0])
        left = (width - part.shape[1]) // 2
        row[:, left : left + part.shape[1]] = part
        parts.append(row)
    return np.concatenate(parts)


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST_NAME else f"{text[: _LONGEST_NAME - 3]}..."


def _ascii(text: str) -> str:
    """Return a text in the letters that OpenCV can draw."""
    return text.encode("ascii", "replace").decode("ascii")
