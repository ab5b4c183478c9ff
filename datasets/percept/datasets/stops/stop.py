"""One scene for calibration, and the settings by which scenes are taken from a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.samples import CameraImage
from percept.core.settings import Settings

__all__ = ["SceneConfig", "Stop"]


class SceneConfig(Settings):
    """How scenes are taken from a log.

    Attributes:
        most_scans: Scans of each LiDAR that are put together at a stop, those in its middle.
        most_images: Images of each camera at a stop of which the sharpest is taken.
        most_stops: Stops that are returned; of more, an even choice.
        keyframe_spacing_m: Least way between two scenes of a vehicle that never stops.
        most_keyframes: Scenes of a vehicle that never stops.
    """

    most_scans: int = Field(default=10, ge=1, le=50)
    most_images: int = Field(default=5, ge=1, le=50)
    most_stops: int = Field(default=80, ge=1, le=1000)
    keyframe_spacing_m: float = Field(default=5.0, gt=0)
    most_keyframes: int = Field(default=10, ge=2, le=50)


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """What the sensors saw while everything that matters stood still, or at one instant.

    Attributes:
        start_ns: Stamp of the first scan of the span.
        end_ns: Stamp of the last one; the same as `start_ns` for an instant of a moving vehicle.
        clouds: By topic, (N, 3) float32 points in the sensor's frame, metres. A LiDAR that gave
            nothing is missing.
        images: By topic, the sharpest image of the span. A camera that gave none is missing.
        cloud_frames: By topic of `clouds`, the name of the sensor's frame.
        note: What a user should know of this stop; empty where there is nothing.
        place: The same number while the vehicle stands at the same place: stops with different
            numbers are independent scenes.
        held_cells: How many directions (of 1 deg by 1 deg, all LiDARs) show something that is
            held before the background; 0 where nothing was brought into the scene.
        moving: Whether the vehicle moved, and its odometry brought the points to one instant.
    """

    start_ns: int
    end_ns: int
    clouds: dict[str, NDArray[np.float32]]
    images: dict[str, CameraImage]
    cloud_frames: dict[str, str]
    note: str = ""
    place: int = 0
    held_cells: int = 0
    moving: bool = False
