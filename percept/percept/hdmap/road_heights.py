"""Heights of the road in a map, and poses brought to them.

GNSS gives heights over the ellipsoid, many maps give them over the sea (tens of metres apart), and
some give none. What is compared in three dimensions needs both in one.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.core.trajectory import Trajectory

__all__ = ["RoadHeights"]

_F64 = NDArray[np.float64]

_STEP_M = 2.0
_NEAR_M = 15.0
_MOST_POSES = 500
_TRUSTED_M = 3.0  # vehicles' frames lie up to so high over the road
_HANGS_M = 1.5


class RoadHeights:
    """Heights of the lines of a map, below places on the road.

    Args:
        lines: (K, 3) float64 points of each line in the map frame.
    """

    def __init__(self, lines: Collection[_F64]) -> None:
        points = [_dense(line) for line in lines if len(line)]
        self._points = np.concatenate(points) if points else np.zeros((0, 3))
        self._tree = cKDTree(self._points[:, :2])

    def below(self, places_map: _F64) -> _F64:
        """Return the height (N,) of the line nearest to places (N, 2 or more); NaN without lines.

        A line further away than 15 m says nothing: NaN.
        """
        if not len(self._points):
            return np.full(len(places_map), np.nan)
        distance, nearest = self._tree.query(places_map[:, :2])
        return np.where(distance <= _NEAR_M, self._points[nearest, 2], np.nan)

    def levelled(self, poses: Trajectory) -> tuple[Trajectory, float]:
        """Return poses whose heights are those of the map, and by how much they were lower.

        Poses within 3 m of the map's heights stay as they are.

        Args:
            poses: `T_map_base`.
        """
        places = poses.matrices[:: max(1, len(poses) // _MOST_POSES), :3, 3]
        over = places[:, 2] - self.below(places)
        over = over[np.isfinite(over)]
        lift = -float(np.median(over)) if len(over) else 0.0
        if abs(lift) <= _TRUSTED_M:
            return poses, 0.0
        matrices = poses.matrices.copy()
        matrices[:, 2, 3] += lift
        return replace(poses, matrices=matrices), lift

    def hang(self, things_map: Collection[_F64]) -> int:
        """Return how many things, of points (K, 3) each, hang over the road and not on it."""
        middles = np.array([points.mean(axis=0) for points in things_map]).reshape(-1, 3)
        over = middles[:, 2] - self.below(middles)
        return int((~(over < _HANGS_M)).sum())


def _dense(line: _F64) -> _F64:
    """Return points (M, 3) of a line, at most about two metres apart."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    places = np.linspace(0.0, along[-1], int(along[-1] / _STEP_M) + 2)
    return np.column_stack([np.interp(places, along, line[:, axis]) for axis in range(3)])
