"""The drive seen from above: the vehicle's path and the trails of what it saw."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.export.canvas import (
    FIXED_SHIFT,
    TEXT,
    Image,
    blank,
    draw_scale_bar,
    fixed_point,
    with_header,
    write_text,
)
from percept.export.palette import class_colours

__all__ = ["trails_from_above"]

_LARGEST_PX = 900
_SMALLEST_PX = 240
_MARGIN_PX = 40
_LEAST_EXTENT_M = 20.0
_MOVED_M = 1.0


def trails_from_above(
    trails: Sequence[tuple[str, NDArray[np.floating]]], path: NDArray[np.floating] | None = None
) -> Image:
    """Draw where tracked objects went, x to the right and y up: north up in a map.

    What hardly moved is a dot, and a trail ends in one.

    Args:
        trails: Of each object its class and its places (N, 2) in order of time, metres.
        path: Places (M, 2) of the vehicle in the same frame; None where the frame is its own,
            which puts it at the origin.

    Returns:
        (H, W, 3) uint8 BGR, at most 900 pixels wide or high besides its header.

    Raises:
        GeometryError: If a trail has no place, or a place is no pair of finite numbers.
    """
    ego = np.zeros((1, 2)) if path is None else np.asarray(path, dtype=np.float64)
    places = [np.asarray(trail, dtype=np.float64) for _, trail in trails]
    for place in [ego, *places]:
        if place.ndim != 2 or place.shape[1:] != (2,) or not len(place):
            raise GeometryError(f"{place.shape} is no trail")
        if not np.isfinite(place).all():
            raise GeometryError("a trail has a place that is not finite")
    low, scale, image = _ground(np.concatenate([ego, *places]))
    colours = class_colours(sorted({label for label, _ in trails}))

    def pixels(points: NDArray[np.float64]) -> NDArray[np.float64]:
        columns, rows = (points - low).T * scale + _MARGIN_PX
        return np.column_stack([columns, image.shape[0] - 1 - rows])

    _draw(image, pixels(ego), TEXT, 3)
    for (label, _), place in zip(trails, places, strict=True):
        _draw(image, pixels(place), colours[label], 2, moved=np.ptp(place, 0).max() > _MOVED_M)
    column, row = pixels(ego)[-1]
    write_text(image, "vehicle", (int(column) + 8, int(row) - 6))
    draw_scale_bar(image, scale)
    counts = Counter(label for label, _ in trails)
    legend = [(f"{counts[label]} {label}", colours[label]) for label in colours]
    return with_header(image, "Tracks over the vehicle's path", legend)


def _ground(places: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, Image]:
    """Return the lower left corner (2,) m, pixels a metre, and an empty picture around them."""
    low, high = places.min(axis=0), places.max(axis=0)
    extent = np.maximum(high - low, _LEAST_EXTENT_M)
    low = (low + high - extent) / 2
    scale = (_LARGEST_PX - 2 * _MARGIN_PX) / float(extent.max())
    width, height = (max(round(side * scale) + 2 * _MARGIN_PX, _SMALLEST_PX) for side in extent)
    return low, scale, blank(width, height)


def _draw(
    image: Image,
    pixels: NDArray[np.float64],
    colour: tuple[int, int, int],
    thickness: int,
    *,
    moved: bool = True,
) -> None:
    fixed = fixed_point(pixels)
    bgr = colour[::-1]
    if moved:
        cv2.polylines(
            image, [fixed], isClosed=False, color=bgr, thickness=thickness,
            lineType=cv2.LINE_AA, shift=FIXED_SHIFT,
        )  # fmt: skip
    radius = (thickness + 1) << FIXED_SHIFT
    cv2.circle(image, fixed[-1].tolist(), radius, bgr, -1, cv2.LINE_AA, FIXED_SHIFT)
