"""The exact motion of the vehicle that carries the sensors.

In a drive it goes along its lane at about 8 m/s, a little faster and slower in turn, and sways
gently. Height and pitch follow the road through a suspension that averages it, so that
speeds stay smooth where the profile has a corner.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.trajectory import Trajectory
from percept.datasets.synthetic.terrain import Profile

__all__ = ["EGO_LANE_Y_M", "EGO_SPEED_MPS", "EGO_START_X_M", "EgoMotion", "Motion"]

EGO_LANE_Y_M = -5.25
EGO_SPEED_MPS = 8.0
EGO_START_X_M = 36.0

_WHEELBASE_M = 2.8
_SUSPENSION_REACH_M = 1.5
_SURGE_M, _SURGE_RADPS = 2.0, 0.5
_SWAY_M, _SWAY_LENGTH_M = 0.25, 90.0
_STEP_S = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Motion(ABC):
    """Poses of `base_link` (rear axle, on the road) in `map`, in closed form.

    Attributes:
        profile: The road's profile.
        start_ns: Stamp of time 0.
    """

    profile: Profile
    start_ns: int

    def seconds(self, stamp_ns: NDArray[np.int64] | int) -> NDArray[np.float64]:
        """Return the time since the start, s."""
        since: NDArray[np.float64] = (
            np.asarray(stamp_ns, dtype=np.int64) - self.start_ns
        ) / NS_PER_S
        return since

    def poses(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `T_map_base` (N, 4, 4) at times (N,) since the start."""
        x, y, yaw = self._plane(np.asarray(time_s, dtype=np.float64))
        rear = self.profile.mean_height(x, _SUSPENSION_REACH_M)
        front = self.profile.mean_height(x + _WHEELBASE_M, _SUSPENSION_REACH_M)
        climb = np.arctan2(front - rear, _WHEELBASE_M)
        cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(climb), np.sin(climb)
        poses = np.zeros((len(x), 4, 4))
        poses[:, :3, 0] = np.column_stack([cy * cp, sy * cp, sp])
        poses[:, :3, 1] = np.column_stack([-sy, cy, np.zeros(len(x))])
        poses[:, :3, 2] = np.column_stack([-cy * sp, -sy * sp, cp])
        poses[:, :3, 3] = np.column_stack([x, y, rear])
        poses[:, 3, 3] = 1.0
        return poses

    def twist(self, time_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return velocity (N, 3) m/s and angular velocity (N, 3) rad/s in `base_link`.

        By central differences over 2 ms, whose error is below 1e-5 m/s.
        """
        before, at, after = (self.poses(time_s + dt) for dt in (-_STEP_S, 0.0, _STEP_S))
        moved = (after[:, :3, 3] - before[:, :3, 3]) / (2 * _STEP_S)
        velocity = np.einsum("nji,nj->ni", at[:, :3, :3], moved)
        turn = np.einsum("nji,njk->nik", before[:, :3, :3], after[:, :3, :3])
        angular = np.column_stack(
            [
                turn[:, 2, 1] - turn[:, 1, 2],
                turn[:, 0, 2] - turn[:, 2, 0],
                turn[:, 1, 0] - turn[:, 0, 1],
            ]
        ) / (4 * _STEP_S)
        return velocity, angular

    def acceleration_map(
        self, time_s: NDArray[np.float64], point_base: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the acceleration (N, 3) in `map` of a point (3,) of the vehicle, m/s^2."""
        before, at, after = (
            self.poses(time_s + dt) @ np.append(point_base, 1.0)
            for dt in (-5 * _STEP_S, 0.0, 5 * _STEP_S)
        )
        acceleration: NDArray[np.float64] = (before - 2 * at + after) / (5 * _STEP_S) ** 2
        return acceleration[:, :3]

    def trajectory(self, stamps_ns: NDArray[np.int64]) -> Trajectory:
        """Return the poses at stamps (N,), strictly rising."""
        poses = self.poses(self.seconds(stamps_ns))
        return Trajectory("map", "base_link", stamps_ns, poses)

    @abstractmethod
    def _plane(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return x, y and heading (N,) at times (N,)."""


@dataclass(frozen=True, slots=True, eq=False)
class EgoMotion(Motion):
    """A drive along the lane."""

    def _plane(
        self, time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return x, y and heading; the vehicle points where it goes."""
        x = EGO_START_X_M + EGO_SPEED_MPS * time_s + _SURGE_M * np.sin(_SURGE_RADPS * time_s)
        turn = 2 * np.pi / _SWAY_LENGTH_M
        y = EGO_LANE_Y_M + _SWAY_M * np.sin(turn * x)
        return x, y, np.arctan(_SWAY_M * turn * np.cos(turn * x))
