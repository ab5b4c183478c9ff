"""How densely a sensor samples, and how full a cluster is by that measure.

Beams of many sensors stand closer near the horizon than below it, so the density is a profile
over elevation. It makes "few points for its size" mean the same for 16 and for 128 beams, near
and far: walls and cars fill their silhouette, leaves and wire do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from percept.lidar.boxes import FittedBoxes

__all__ = ["estimate_density", "fill_of"]

_CELL_DEG = 2.0
_ROWS = round(180 / _CELL_DEG)
_COLUMNS = round(360 / _CELL_DEG)
_SQUARE_DEG = float(np.rad2deg(1.0) ** 2)


def estimate_density(clouds: Sequence[NDArray[np.floating]]) -> NDArray[np.float64]:
    """Measure the density that solid surfaces are sampled with, by elevation.

    Args:
        clouds: (N, 3) points each, level frame, metres.

    Returns:
        (90,) float64 points per square degree in rows of 2 deg from -90 to 90 deg of elevation:
        what the median point of a row has around itself. NaN where a row has no point.
    """
    counts = np.zeros((_ROWS, _COLUMNS))
    for points in clouds:
        cells = _row_of(points) * _COLUMNS + _column_of(points)
        counts += np.bincount(cells, minlength=_ROWS * _COLUMNS).reshape(counts.shape)
    density = np.full(_ROWS, np.nan)
    for row in np.flatnonzero(counts.any(axis=1)):
        cells = np.sort(counts[row])
        half = np.searchsorted(np.cumsum(cells), cells.sum() / 2)
        density[row] = cells[half] / _CELL_DEG**2 / len(clouds)
    return density


def fill_of(boxes: FittedBoxes, density: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of clusters over those that solid boxes would get, seen from the origin.

    A box is taken one beam spacing larger than it is, or thin things would seem too full.

    Args:
        boxes: K boxes in the level frame.
        density: (90,) from `estimate_density`.

    Returns:
        (K,) float64; NaN where the density is not known.
    """
    x, y, z, length, width, height, yaw = boxes.boxes_m.T
    range_m = np.maximum(np.sqrt(x * x + y * y + z * z), 1.0)
    points_per_deg2 = density[_row_of(boxes.boxes_m)]
    spacing = range_m * np.deg2rad(1.0) / np.sqrt(points_per_deg2)
    aspect = yaw - np.arctan2(y, x)
    across = length * np.abs(np.sin(aspect)) + width * np.abs(np.cos(aspect)) + spacing
    solid_angle = across * (height + spacing) / range_m**2
    fill: NDArray[np.float64] = boxes.points / (points_per_deg2 * solid_angle * _SQUARE_DEG)
    return fill


def _row_of(points: NDArray[np.floating]) -> NDArray[np.int64]:
    elevation = np.rad2deg(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return _cell(elevation + 90.0, _ROWS)


def _column_of(points: NDArray[np.floating]) -> NDArray[np.int64]:
    return _cell(np.rad2deg(np.arctan2(points[:, 1], points[:, 0])) + 180.0, _COLUMNS)


def _cell(angle_deg: NDArray[np.floating], count: int) -> NDArray[np.int64]:
    return np.minimum((angle_deg / _CELL_DEG).astype(np.int64), count - 1)
