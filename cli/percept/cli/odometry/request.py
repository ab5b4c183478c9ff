"""What `percept odometry` was asked for, and its settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from percept.core.settings import Settings
from percept.odometry.filter_config import FilterConfig
from percept.odometry.lidar.config import LidarOdometryConfig

__all__ = ["OdometryConfig", "OdometryRequest", "Source"]

Source = Literal["auto", "gnss", "odometry", "pose", "tf", "lidar"]


class OdometryConfig(Settings):
    """All settings of `percept odometry`.

    Attributes:
        lidar: Odometry by LiDAR.
        filter: The filter over GNSS and IMU.
    """

    lidar: LidarOdometryConfig = Field(default_factory=LidarOdometryConfig)
    filter: FilterConfig = Field(default_factory=FilterConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryRequest:
    """What the command line asked for; see the options of `percept odometry`."""

    bags: tuple[Path, ...]
    rig: Path | None
    source: Source
    topics: tuple[str, ...]
    reference: Path | None
    config: Path | None
    start_s: float | None
    end_s: float | None
    out: Path
    force: bool
