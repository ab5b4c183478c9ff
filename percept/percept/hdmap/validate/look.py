"""One look, placed on the map by the pose and the shift against the map."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation
from percept.hdmap.validate.localise import Shift

__all__ = ["Placed", "Strokes", "usable_strokes"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Strokes:
    """Strokes of one look that can be used; columns as in `PaintObservation`."""

    points_m: _F64
    direction_rad: _F64
    width_m: _F64
    sd_m: _F64
    yellow: _F64
    step_m: float

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def range_m(self) -> _F64:
        """(N,) float64 distance of each from the vehicle."""
        distance: _F64 = np.linalg.norm(self.points_m[:, :2], axis=1)
        return distance


def usable_strokes(look: PaintObservation, range_m: float, dropped: Counter[str]) -> Strokes:
    """Return the finite strokes within a range; count the others."""
    numbers = np.column_stack([look.strokes_m, look.direction_rad, look.width_m, look.sd_m])
    finite: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(numbers), axis=1)
    near = np.zeros(len(finite), dtype=bool)
    near[finite] = np.linalg.norm(look.strokes_m[finite, :2], axis=1) <= range_m
    for what, count in (
        ("strokes with numbers that are not finite", (~finite).sum()),
        ("strokes too far away to judge by", (finite & ~near).sum()),
    ):
        if count:
            dropped[what] += int(count)
    return Strokes(
        look.strokes_m[near],
        look.direction_rad[near],
        look.width_m[near],
        np.maximum(look.sd_m[near], 0.0),
        look.yellow[near],
        look.step_m,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """The vehicle on the map: a pose, and the shift of what it sees against the map.

    Attributes:
        T_map_base: (4, 4) float64 as the log has it.
        shift: Of paint against the map.
    """

    T_map_base: _F64
    shift: Shift

    @property
    def position(self) -> _F64:
        """(2,) float64 of the vehicle in the map frame, as the log has it."""
        position: _F64 = self.T_map_base[:2, 3]
        return position

    @property
    def yaw_rad(self) -> float:
        """Direction of the vehicle in the map frame, corrected."""
        raw = np.arctan2(self.T_map_base[1, 0], self.T_map_base[0, 0])
        return float(raw) - self.shift.heading_rad

    @property
    def heading(self) -> _F64:
        """(2,) float64 unit vector of `yaw_rad`."""
        return np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad)])

    def to_map(self, points_m: _F64) -> _F64:
        """Return points (N, 3) of the vehicle's frame in the map frame (N, 3), corrected."""
        turned = points_m @ self.T_map_base[:3, :3].T
        turned[:, :2] = turned[:, :2] @ _turn(-self.shift.heading_rad).T
        placed: _F64 = turned + self.T_map_base[:3, 3]
        placed[:, :2] -= self._aside()
        return placed

    def to_base(self, points_map: _F64) -> _F64:
        """Return points (N, 2) of the map where the vehicle sees them, in its frame (N, 2)."""
        apart = points_map - self.position + self._aside()
        seen: _F64 = apart @ _turn(-self.yaw_rad).T
        return seen

    def _aside(self) -> _F64:
        return self.shift.lateral_m * np.array([-self.heading[1], self.heading[0]])


def _turn(angle_rad: float) -> _F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
