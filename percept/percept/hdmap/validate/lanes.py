"""Which places lie on a lane of the map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.elements import Lanelet

__all__ = ["in_lanes"]

_F64 = NDArray[np.float64]
_Bool = NDArray[np.bool_]

_BORDER_M = 0.6


def in_lanes(points: _F64, lanelets: Mapping[int, Lanelet]) -> _Bool:
    """Return which points (N, 2) lie on a lanelet, or on the paint of its border.

    Args:
        points: In the map frame.
        lanelets: Of the map.
    """
    inside = np.zeros(len(points), dtype=bool)
    low, high = points.min(axis=0) - _BORDER_M, points.max(axis=0) + _BORDER_M
    for lanelet in lanelets.values():
        outline = np.concatenate([lanelet.left_map[:, :2], lanelet.right_map[::-1, :2]])
        if (outline.max(axis=0) < low).any() or (outline.min(axis=0) > high).any():
            continue
        inside |= _within(points, outline) | _beside(points, outline)
    return inside


def _within(points: _F64, outline: _F64) -> _Bool:
    """Return which points (N, 2) lie in a polygon (K, 2): a ray to +x crosses it oddly often."""
    start, end = outline, np.roll(outline, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    crosses = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    at = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    within: _Bool = (crosses & (x < at)).sum(axis=1) % 2 == 1
    return within


def _beside(points: _F64, outline: _F64) -> _Bool:
    """Return which points (N, 2) are near an edge of a polygon (K, 2)."""
    start, edge = outline, np.roll(outline, -1, axis=0) - outline
    square = np.maximum((edge**2).sum(axis=1), 1e-12)
    apart = points[:, None] - start
    share = np.clip((apart * edge).sum(axis=2) / square, 0.0, 1.0)
    distance = np.linalg.norm(apart - share[..., None] * edge, axis=2)
    near: _Bool = distance.min(axis=1) <= _BORDER_M
    return near
