"""Settings of the detection of lanes in one image."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["LaneConfig"]


class LaneConfig(Settings):
    """How lines are looked for.

    Attributes:
        method: `windows` thresholds paint in the bird's-eye view and follows it with sliding
            windows; `hough` enhances contrast and joins segments of the probabilistic Hough
            transform.
        camera_height_m: Height of the camera over the road, where the rig does not say where the
            camera sits or its base frame is not on the ground. Without any the result is in
            pixels.
        reach_m: How far ahead lines are looked for.
        half_width_m: How far to either side.
        line_width_m: Width of one line of paint.
        lane_width_m: Bounds of a lane's width.
        stop_line_width_m: Bounds of the extent of a stop line along the road.
        contrast: From which logarithmic contrast to both sides a place may be paint.
        noise: The same as a multiple of the contrasts around it.
        min_paint_m: Length of paint that a line needs.
        pitch_sd_deg: Spread of the pitch of the road against the vehicle that is left after its
            correction; for the stated accuracy.
    """

    method: Literal["windows", "hough"] = "windows"
    camera_height_m: float | None = Field(None, gt=0.2, lt=5)
    reach_m: float = Field(50.0, ge=10, le=150)
    half_width_m: float = Field(8.0, ge=3, le=20)
    line_width_m: float = Field(0.13, gt=0.04, le=0.5)
    lane_width_m: tuple[float, float] = (2.4, 4.8)
    stop_line_width_m: tuple[float, float] = (0.2, 0.7)
    contrast: float = Field(0.06, gt=0, lt=1)
    noise: float = Field(3.0, gt=0, le=20)
    min_paint_m: float = Field(2.0, gt=0, le=50)
    pitch_sd_deg: float = Field(0.25, gt=0, le=5)
