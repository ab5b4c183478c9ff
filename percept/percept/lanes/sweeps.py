"""Sweeps of LiDARs put together to one view of the road: one sweep is too sparse to show paint.

Heights are kept above the road of each sweep's own moment: poses by GNSS rise and fall by more
than paint and kerbs differ, and a vehicle pitches, but a road stays a road.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform
from percept.lanes.ground import GroundSurface

__all__ = ["RoadSweep", "RoadView", "SweepWindow", "road_sweep"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_REACH_M, _HALF_WIDTH_M = 25.0, 12.0
_ABOVE_M = 0.15  # kerbs and tyres are higher; the road itself is uneven by a few centimetres
_MARGIN_M = 0.3  # boxes are drawn about the points that were seen: feet and shades lie beside
_APART_M = 0.3  # of sweeps: a vehicle that stands sees the same rings again


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoadSweep:
    """What one sweep shows of the road.

    Attributes:
        T_map_base: Where the vehicle was.
        ground: The road's surface in the vehicle's frame there.
        points: (N, 4) float32 x, y in that frame, height above the road, intensity.
    """

    T_map_base: Transform
    ground: GroundSurface
    points: _F32


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoadView:
    """What several sweeps show of the road.

    Attributes:
        points_base: (N, 4) float64 x, y, z in the vehicle's frame at the newest of them, and
            intensity.
        ground: The road's surface in that frame.
    """

    points_base: _F64
    ground: GroundSurface


def road_sweep(
    points_base: NDArray[np.floating],
    intensity: NDArray[np.floating],
    *,
    ground: GroundSurface,
    boxes_m: NDArray[np.floating],
    T_map_base: Transform,
) -> RoadSweep:
    """Return the points of a sweep that lie on the road, and not on or under a thing on it.

    Args:
        points_base: (N, 3) points in the vehicle's frame.
        intensity: (N,) of the points, in any unit.
        ground: The road's surface in that frame, made from points.
        boxes_m: (M, 7) boxes of things in that frame.
        T_map_base: Where the vehicle was.

    Raises:
        GeometryError: If points and intensity are not of one length.
    """
    points = np.asarray(points_base, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or np.shape(intensity) != (len(points),):
        raise GeometryError("a sweep has points (N, 3) with an intensity each")
    near = (np.abs(points[:, 0]) < _REACH_M) & (np.abs(points[:, 1]) < _HALF_WIDTH_M)
    near &= np.isfinite(points).all(axis=1) & np.isfinite(intensity)
    rows = np.flatnonzero(near)
    above = points[rows, 2] - ground.height(points[rows])
    low = np.abs(above) < _ABOVE_M
    rows, above = rows[low], above[low]
    free = ~_in_boxes(points[rows, :2], np.asarray(boxes_m, dtype=np.float64).reshape(-1, 7))
    rows, above = rows[free], above[free]
    kept = np.column_stack([points[rows, :2], above, np.asarray(intensity)[rows]])
    return RoadSweep(T_map_base=T_map_base, ground=ground, points=kept.astype(np.float32))


class SweepWindow:
    """Keeps the sweeps of the last metres of way, and puts them together now and then.

    Memory is bounded by the length of the window: sweeps at one place are kept once.

    Args:
        length_m: The way over which sweeps are put together.
        spacing_m: The way between two views.
    """

    def __init__(self, length_m: float = 10.0, spacing_m: float = 2.0) -> None:
        self._length_m = length_m
        self._spacing_m = spacing_m
        self._sweeps: deque[tuple[float, RoadSweep]] = deque()
        self._along_m = 0.0
        self._viewed_m = 0.0

    def push(self, sweep: RoadSweep) -> RoadView | None:
        """Take the next sweep, and return a view from it where one is due.

        None is due where the vehicle has not gone far enough since the last view.
        """
        if self._sweeps:
            last_m, last = self._sweeps[-1]
            way_m = _distance(last.T_map_base, sweep.T_map_base)
            if way_m < _APART_M:
                return None
            self._along_m = last_m + way_m
        self._sweeps.append((self._along_m, sweep))
        while self._sweeps[0][0] < self._along_m - self._length_m:
            self._sweeps.popleft()
        if self._along_m - self._viewed_m < self._spacing_m:
            return None
        self._viewed_m = self._along_m
        return self._together(sweep)

    def _together(self, newest: RoadSweep) -> RoadView:
        T_now_map = newest.T_map_base.inverse()
        parts = []
        for _, sweep in self._sweeps:
            x_y, above, intensity = np.split(sweep.points.astype(np.float64), [2, 3], axis=1)
            on_road = np.column_stack([x_y, sweep.ground.height(x_y)])
            placed = (T_now_map @ sweep.T_map_base).apply(on_road)[:, :2]
            height = newest.ground.height(placed)[:, None] + above
            parts.append(np.concatenate([placed, height, intensity], axis=1))
        return RoadView(points_base=np.concatenate(parts), ground=newest.ground)


def _distance(one: Transform, other: Transform) -> float:
    return float(np.linalg.norm(one.translation_m - other.translation_m))


def _in_boxes(points: _F64, boxes: _F64) -> NDArray[np.bool_]:
    """Return which points (N, 2) lie in the outline of a box (M, 7), a little larger."""
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        cos, sin = np.cos(box[6]), np.sin(box[6])
        apart = points - box[:2]
        along = np.abs(cos * apart[:, 0] + sin * apart[:, 1])
        across = np.abs(cos * apart[:, 1] - sin * apart[:, 0])
        inside |= (along < box[3] / 2 + _MARGIN_M) & (across < box[4] / 2 + _MARGIN_M)
    return inside
