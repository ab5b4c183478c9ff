"""Settings of paint on the road, each with the reason for its default."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["PaintConfig"]


class PaintConfig(Settings):
    """How paint is told from the road in the view from above.

    Attributes:
        reach_m: Lines further ahead are not looked for: 0.25 deg of yaw are 9 cm there.
        half_width_m: Nor those further to the side.
        bar_reach_m: Bars across the road further ahead are not looked for: 0.25 deg of pitch
            are half a metre there.
        line_widths_m: Widths of lines that are matched: thin lines, and wide ones or pairs that
            run together far away.
        bar_widths_m: Least and greatest extent of a stop line along the road.
        least_bar_m: A bar across the road is at least so long.
        contrast: Logarithm of paint over road from which something is paint; worn paint has 0.2.
        noise: And so many times the contrasts that are usual around it.
        coarsest_m: Where a pixel covers more of the road across a line, none is looked for: a
            line of 0.12 m is then one pixel.
        darkest: Mean grey level below which nothing can be told.
        rotation_sd_deg: How well the direction of the camera against the vehicle is known.
        step_m: A stroke stands for so much of a line.
    """

    reach_m: float = Field(default=20.0, gt=3, le=60)
    half_width_m: float = Field(default=9.0, gt=1, le=30)
    bar_reach_m: float = Field(default=14.0, gt=3, le=40)
    line_widths_m: tuple[float, ...] = (0.12, 0.24)
    bar_widths_m: tuple[float, float] = (0.2, 0.8)
    least_bar_m: float = Field(default=1.8, gt=0)
    contrast: float = Field(default=0.16, gt=0)
    noise: float = Field(default=3.0, ge=0)
    coarsest_m: float = Field(default=0.11, gt=0)
    darkest: float = Field(default=14.0, ge=0)
    rotation_sd_deg: float = Field(default=0.1, gt=0)
    step_m: float = Field(default=0.5, gt=0)
