"""What `percept map validate` is asked for: its settings, and the request of one run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import Field

from percept.cli.detect.request import ModelRequest
from percept.cli.odometry.request import OdometryConfig, Source
from percept.core.settings import Settings
from percept.detection.yolo_config import YoloConfig
from percept.hdmap.validate import ValidationConfig
from percept.lanes import PaintConfig
from percept.lidar.pipeline import LidarConfig
from percept.lights.map_check import LightCheckConfig

__all__ = ["MapValidateConfig", "MapValidateRequest"]


class MapValidateConfig(Settings):
    """All settings of `percept map validate`.

    Attributes:
        spacing_m: Between two images of a camera that are looked at, the vehicle goes so far.
        odometry: How poses are found.
        lidar: The LiDAR pipeline, which tells what hides the road.
        models: Settings of each network by the name that `--model` gives it.
        paint: How paint is found in images.
        validation: When map and road disagree.
        lights: When a traffic light is missing.
        lidar_paint: Whether lines are looked for in the intensity of the LiDARs too: they see at
            night and to all sides, but neither colours, nor pairs, nor stop lines.
    """

    spacing_m: float = Field(default=1.0, gt=0, le=50)
    odometry: OdometryConfig = Field(default_factory=OdometryConfig)
    lidar: LidarConfig = Field(default_factory=LidarConfig)
    models: dict[str, YoloConfig] = Field(default_factory=dict)
    paint: PaintConfig = Field(default_factory=PaintConfig)
    validation: ValidationConfig = Field(default_factory=ValidationConfig)
    lights: LightCheckConfig = Field(default_factory=LightCheckConfig)
    lidar_paint: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MapValidateRequest:
    """What the command line asked for; see the options of `percept map validate`."""

    bags: tuple[Path, ...]
    map_file: Path
    out: Path
    origin: str | None = None
    rig: Path | None = None
    cameras: Mapping[str, str] = field(default_factory=dict)
    models: tuple[ModelRequest, ...] = ()
    models_are_default: bool = False
    lane_model: Path | None = None
    poses: Source = "auto"
    reviews: tuple[Path, ...] = ()
    config: Path | None = None
    flags: Mapping[str, Any] = field(default_factory=dict)
    start_s: float | None = None
    end_s: float | None = None
    force: bool = False
