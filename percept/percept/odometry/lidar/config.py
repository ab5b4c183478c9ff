"""Settings of LiDAR odometry, and the limits that its verdict rests on."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["LidarOdometryConfig"]


class LidarOdometryConfig(Settings):
    """Settings of LiDAR odometry.

    The defaults are those of KISS-ICP (Vizzo et al. 2023, section IV) where it has them.

    Attributes:
        max_range_m: Points farther away than this are not used.
        min_range_m: Points nearer than this are not used: they are the vehicle's own.
        voxel_m: Edge of a cell of the local map; a hundredth of `max_range_m` where None.
        deskew: Whether the motion during a scan is taken out by the times of its points.
        max_speed_mps: A motion between two scans that is faster than this is a jump.
        max_acceleration_mps2: A change of the speed that is larger than this is a jump.
        max_turn_radps: A turn between two scans that is faster than this is a jump.
        restart_after: Scans in a row that fail before a new map is begun behind a gap.
    """

    max_range_m: float = Field(default=100.0, gt=1, le=1000)
    min_range_m: float = Field(default=1.5, ge=0)
    voxel_m: float | None = Field(default=None, gt=0.01, le=10)
    deskew: bool = True
    max_speed_mps: float = Field(default=70.0, gt=0)
    max_acceleration_mps2: float = Field(default=20.0, gt=0)
    max_turn_radps: float = Field(default=2.5, gt=0)
    restart_after: int = Field(default=5, ge=1)

    @property
    def cell_m(self) -> float:
        """Edge of a cell of the local map, metres."""
        return self.max_range_m / 100 if self.voxel_m is None else self.voxel_m
