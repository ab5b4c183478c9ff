"""White or yellow: the colour of a line against the road beside it."""

from __future__ import annotations

import numpy as np

from percept.lanes.line_type import LineStrip

__all__ = ["line_colour"]

_YELLOW = 0.25  # logarithm of red and green over blue, above that of the road beside it
_WHITE = 0.2
_LEAST_ROWS = 5
_MIDDLE_M = 0.06


def line_colour(
    light: LineStrip, yellow: LineStrip, places_m: tuple[float, ...], least: float
) -> str:
    """Return `white`, `yellow` or `unknown`.

    The road beside the paint is the reference, so that the colour of the light and the camera's
    white balance cancel.

    Args:
        light: Strip of the lightness.
        yellow: Strip of the yellowness.
        places_m: Offsets of the line, or of both lines of a pair.
        least: Contrast from which a row shows paint at all.
    """
    columns = np.min([np.abs(light.offset_m - p) for p in places_m], axis=0) <= _MIDDLE_M
    paint = np.maximum(light.contrast, yellow.contrast)[:, columns].mean(axis=1)
    rows = light.inside & (paint > max(least, 0.5 * float(np.percentile(paint, 85))))
    if rows.sum() < _LEAST_ROWS:
        return "unknown"
    value = float(np.median(yellow.contrast[rows][:, columns].mean(axis=1)))
    return "yellow" if value > _YELLOW else "white" if value < _WHITE else "unknown"
