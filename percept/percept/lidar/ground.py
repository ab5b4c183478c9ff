"""Ground segmentation by line fits in polar segments.

M. Himmelsbach, F. v. Hundelshausen, H.-J. Wuensche, "Fast segmentation of 3D point clouds for
ground vehicles", IEEE Intelligent Vehicles Symposium 2010, in the form that
`linefit_ground_segmentation` gave it: prototypes are the lowest points of radial bins, lines
grow outwards from the sensor's height over the ground, and points are labelled by their
vertical distance to the line below or above them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from percept.core.errors import ConfigError
from percept.core.settings import Settings
from percept.lidar.points import as_columns, finite_rows

__all__ = ["GroundConfig", "segment_ground"]


class GroundConfig(Settings):
    """How the ground is found. Frame: z up, level, origin `sensor_height_m` over the ground.

    The defaults suit the LiDARs of a car, from 16 to 128 beams. What they trade:

    - Rings of beams lie up to 5 m apart where lines have to begin, hence `long_threshold_m`.
    - A slope of 10 % has risen by 0.4 m where the first ring meets it, hence
      `max_start_height_m`; `max_slope` leaves room for a ramp and some tilt on top.
    - `max_dist_to_line_m` is what a road's texture, noise and the line's own error add up to.
      More keeps rough ground together, less keeps kerbs and the feet of pedestrians.

    Attributes:
        sensor_height_m: Height of the frame's origin over the ground, m. The default is the roof
            of a car; there is no good default for other vehicles, see `estimate_mounting`.
        segments: Angular segments of the full circle.
        bins: Radial bins between `r_min_m` and `r_max_m`.
        r_min_m: Points nearer than this (horizontally) are not ground: they are the vehicle.
        r_max_m: Points farther than this are not ground: beams are too far apart to tell.
        max_dist_to_line_m: Vertical distance to the line up to which a point is ground, m.
        min_slope: Lines flatter than this are refused (|dz/dr|); 0 allows all.
        max_slope: Lines steeper than this are refused (|dz/dr|).
        max_fit_error_m: Largest residual of a prototype in its line, m.
        long_threshold_m: Gap between prototypes from which a line counts as long, m.
        max_long_height_m: In a long line, largest step from the prediction to a prototype, m.
        max_start_height_m: A line starts at most this far from the ground height so far, m.
        line_search_angle_rad: Where a segment has no line at a range, segments up to this
            angle to both sides are asked.
    """

    sensor_height_m: float = Field(default=1.8, ge=0.0, le=5.0)
    segments: int = Field(default=360, ge=8, le=3600)
    bins: int = Field(default=160, ge=4, le=4096)
    r_min_m: float = Field(default=0.5, ge=0.0, le=100.0)
    r_max_m: float = Field(default=100.0, gt=0.0, le=1000.0)
    max_dist_to_line_m: float = Field(default=0.18, gt=0.0, le=2.0)
    min_slope: float = Field(default=0.0, ge=0.0, le=1.0)
    max_slope: float = Field(default=0.25, gt=0.0, le=2.0)
    max_fit_error_m: float = Field(default=0.15, gt=0.0, le=2.0)
    long_threshold_m: float = Field(default=5.0, gt=0.0, le=100.0)
    max_long_height_m: float = Field(default=0.2, gt=0.0, le=5.0)
    max_start_height_m: float = Field(default=0.5, gt=0.0, le=5.0)
    line_search_angle_rad: float = Field(default=0.33, ge=0.0, le=3.1)

    @model_validator(mode="after")
    def _check_order(self) -> GroundConfig:
        if self.r_min_m >= self.r_max_m:
            raise ConfigError(f"r_min_m {self.r_min_m} must be below r_max_m {self.r_max_m}")
        if self.min_slope >= self.max_slope:
            raise ConfigError(f"min_slope {self.min_slope} must be below {self.max_slope}")
        return self


def segment_ground(
    points: NDArray[np.floating], config: GroundConfig | None = None
) -> NDArray[np.bool_]:
    """Label the ground points of one scan.

    Args:
        points: (N, 3 or more) float32 x, y, z, metres, in a level frame with z up.
        config: Settings; None takes the defaults, whose sensor height is a car's roof.

    Returns:
        (N,) bool, True where a point is ground. Points outside `r_min_m`..`r_max_m` and points
        with a coordinate that is not finite are False.

    Raises:
        GeometryError: If the points are not (N, 3+).
    """
    from percept.lidar.ground_kernels import LineLimits, fit_lines
    from percept.lidar.label_kernels import LabelLimits, bands_of_bins, cover_of_bins, label_points
    from percept.lidar.polar_bins import PolarGrid, bins_of_points, lowest_of_bins

    config = config or GroundConfig()
    columns = as_columns(points)
    if columns is None:
        finite = finite_rows(points)
        finite[finite] = segment_ground(np.asarray(points)[finite], config)
        return finite
    grid = PolarGrid(config.segments, config.bins, config.r_min_m, config.r_max_m)
    line_limits = LineLimits(
        config.sensor_height_m,
        config.min_slope,
        config.max_slope,
        config.max_fit_error_m,
        config.long_threshold_m,
        config.max_long_height_m,
        config.max_start_height_m,
    )
    label_limits = LabelLimits(config.max_dist_to_line_m, config.line_search_angle_rad)
    place = bins_of_points(columns, grid)
    prototypes = lowest_of_bins(columns, place, grid)
    lines = fit_lines(prototypes, line_limits)
    cover = cover_of_bins(lines, grid)
    bands = bands_of_bins(cover, prototypes.bins, grid, label_limits)
    return label_points(columns, place, bands, lines, cover, grid, label_limits)
