"""What `percept detect` is asked for: its settings, and the request of one run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from percept.cli.odometry.request import OdometryConfig, Source
from percept.cli.track.request import TrackConfig
from percept.core.settings import Settings
from percept.detection.yolo_config import YoloConfig
from percept.lidar.pipeline import LidarConfig

__all__ = ["CameraConfig", "DetectConfig", "DetectRequest", "ModelRequest"]


class CameraConfig(Settings):
    """Settings of the camera half that all models share.

    Attributes:
        device: What runs the networks; `auto` takes a GPU where onnxruntime has one.
        undistort: Take the lens out of the images before the networks see them. Boxes are in
            pixels of the recorded image all the same.
        preview: Run networks with a free input size at half of it: a quick look.
        max_scan_gap_ms: A box gets its place from the scan nearest in time, if that is within
            so many milliseconds of the image.
    """

    device: Literal["auto", "cpu", "cuda", "openvino"] = "auto"
    undistort: bool = False
    preview: bool = False
    max_scan_gap_ms: float = Field(default=100.0, ge=0)


class DetectConfig(TrackConfig):
    """All settings of `percept detect`.

    Attributes:
        lidars: `merge` or `separate`; None merges where the place of every LiDAR is known.
        lidar: The LiDAR pipeline.
        camera: What all models share.
        models: Settings of each model by the name that `--model` gives it.
        odometry: How poses are found.
        tracking: The tracker of objects.
        lights: The tracker of traffic lights.
    """

    lidars: Literal["merge", "separate"] | None = None
    lidar: LidarConfig = Field(default_factory=LidarConfig)
    camera: CameraConfig = Field(default_factory=CameraConfig)
    models: dict[str, YoloConfig] = Field(default_factory=dict)
    odometry: OdometryConfig = Field(default_factory=OdometryConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRequest:
    """One `--model`.

    Attributes:
        name: What the run calls it.
        path: The ONNX file.
        every: Of each camera, it looks at one image in so many.
        classes: File with its class names, or None.
    """

    name: str
    path: Path
    every: int = 1
    classes: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectRequest:
    """What the command line asked for; see the options of `percept detect`."""

    bags: tuple[Path, ...]
    out: Path
    rig: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    models: tuple[ModelRequest, ...] = ()
    config: Path | None = None
    flags: Mapping[str, Any] = field(default_factory=dict)
    start_s: float | None = None
    end_s: float | None = None
    track: bool = True
    poses: Source = "auto"
    map_file: Path | None = None
    origin: str | None = None
    lidar_only: bool = False
    camera_only: bool = False
    overlay: bool = False
    resume: bool = False
    force: bool = False
