"""Sliding windows: from peaks near the vehicle up the bird's-eye view."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.road_grid import RoadGrid

__all__ = ["follow_windows"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_WINDOW_M = 2.0  # along
_HALF_M = 0.4  # across
_LONGEST_GAP_M = 14.0  # more than a gap between dashes
_MEMORY_M = 10.0  # what the direction of the next window is taken from
_SEED_M = (0.0, 25.0)  # ahead of the first row
_SEED_PAINT_M = 1.0
_PEAKS_APART_M = 0.45


def follow_windows(evidence: _F32, grid: RoadGrid) -> list[_F64]:
    """Return courses (rows,) y of each row that windows found, one for each peak.

    Args:
        evidence: (rows, columns) float32 0..1 on the grid.
        grid: The grid.
    """
    return [
        found
        for y_m in _peaks(evidence, grid)
        if (found := _followed(evidence, grid, y_m)) is not None
    ]


def _peaks(evidence: _F32, grid: RoadGrid) -> _F64:
    """Return lateral places at which paint is summed up along the near part of the road."""
    first, last = (grid.rows(d) if d else 0 for d in _SEED_M)
    summed = evidence[first:last].sum(axis=0) * grid.step_m
    smooth = cv2.GaussianBlur(summed[None], (0, 0), sigmaX=grid.cells(0.1))[0]
    around = cv2.dilate(smooth[None], np.ones((1, 2 * grid.cells(_PEAKS_APART_M) + 1)))[0]
    # A line that is 4 to 5 cells wide loses about half of its height to the smoothing.
    found: _F64 = grid.y_m[(smooth == around) & (smooth >= 0.5 * _SEED_PAINT_M)]
    return found


def _followed(evidence: _F32, grid: RoadGrid, y_m: float) -> _F64 | None:
    rows, half = grid.rows(_WINDOW_M), grid.cells(_HALF_M)
    seen: list[tuple[float, float, float]] = []
    since = 0.0
    for start in range(0, len(grid.x_m), rows):
        x_m = float(grid.x_m[start : start + rows].mean())
        expected = _expected(seen, x_m, y_m)
        middle = round(float(grid.column(np.array(expected))))
        low, high = max(0, middle - half), middle + half + 1
        window = evidence[start : start + rows, low:high] if high > 0 else evidence[:0, :0]
        mass = float(window.sum())
        if mass < 0.1 * rows:
            since += _WINDOW_M
            if seen and since > _LONGEST_GAP_M:
                break
            continue
        since = 0.0
        y = float((window.sum(axis=0) * grid.y_m[low:high]).sum() / mass)
        seen.append((x_m, y, mass))
    if not seen:
        return None
    x, y, _ = np.array(seen).T
    inner = np.interp(grid.x_m, x, y)
    # Before the first window the line goes on as in the first ones.
    first = seen[: max(2, int(_MEMORY_M / _WINDOW_M))]
    slope = _direction(first)
    course: _F64 = np.where(grid.x_m < x[0], y[0] + slope * (grid.x_m - x[0]), inner)
    return course


def _expected(seen: list[tuple[float, float, float]], x_m: float, y_m: float) -> float:
    """Return where the next window goes: on in the direction of the last ones."""
    if not seen:
        return y_m
    recent = [s for s in seen if s[0] > seen[-1][0] - _MEMORY_M]
    x, y, _ = np.array(recent).T
    return float(y.mean() + _direction(recent) * (x_m - x.mean()))


def _direction(seen: list[tuple[float, float, float]]) -> float:
    x, y, _ = np.array(seen).T
    # As if the line had been seen straight ahead before: two windows alone fix no direction.
    spread = ((x - x.mean()) ** 2).sum() + 2 * _WINDOW_M**2
    return float(((x - x.mean()) * (y - y.mean())).sum() / spread)
