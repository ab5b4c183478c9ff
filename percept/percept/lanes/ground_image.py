"""The surface of the road from one image, where there is no LiDAR.

A camera that is pitched by a little, or a road that rises, makes the parallel lines of the road
come apart in a view that is made for flat ground; see `percept.lanes.profile`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.lanes.birdseye import BirdsEye, BirdsEyeGrid
from percept.lanes.ground import GroundSurface, flat_ground
from percept.lanes.paint_config import PaintConfig
from percept.lanes.profile import RoadProfile, fit_profile
from percept.lanes.strokes import Strokes, find_strokes

__all__ = ["ground_from_image"]

_F64 = NDArray[np.float64]

_SHORTEST_M = 2.0  # of a chain of strokes: a dash
_MOST_LINES = 8
_LEAST_PAINT_M = 8.0
_LEAST_APART_M = 1.5
_LEAST_PIECE_M = 0.1
_TOLD_M = 15.0
_STEEPEST = 0.2  # grade, against the vehicle: streets have no more than 0.15
_STEP_M = 0.1  # of the rows that a profile is fitted to
# What is left of height and grade after the fit: against true profiles of synthetic streets.
_SD_M, _GRADE_SD = 0.02, 0.005


def ground_from_image(
    image: NDArray[np.uint8], camera: CameraSensor, config: PaintConfig | None = None
) -> GroundSurface:
    """Return the road's surface on which the lines of an image are parallel.

    Where the image has no two lines it is flat. Notes say which, and by how much the
    camera's pitch was corrected.

    Args:
        image: (H, W, 3) uint8 BGR, as it was recorded.
        camera: Its lens and place.
        config: Settings.

    Raises:
        ConfigError: If the camera's place on the vehicle is not known.
        GeometryError: If the intrinsics make no camera.
    """
    config = config or PaintConfig()
    view = BirdsEye(camera, flat_ground(), BirdsEyeGrid.ahead_of(camera, config))
    lines = _lines(find_strokes(view, view.image(image), config), view.eye_m)
    paint_m = sum(float(np.ptp(line[0])) for line in lines)
    middles = [float(line[1].mean()) for line in lines]
    if paint_m < _LEAST_PAINT_M or float(np.ptp(middles)) < _LEAST_APART_M:
        note = "The image shows no two lines to tell the road's shape by: it is taken as flat."
        return replace(view.ground, notes=(note,))
    profile = fit_profile(lines, camera.K[:2], float(view.eye_m[2]))
    return _surface(profile, view.eye_m)


def _lines(strokes: Strokes, eye_m: _F64) -> list[_F64]:
    """Return the longest chains of strokes, each (2, N) of distances ahead and to the left."""
    found = []
    for number in np.unique(strokes.chain):
        ahead, left = (strokes.points_m[strokes.chain == number, :2] - eye_m[:2]).T
        if np.ptp(ahead) >= _SHORTEST_M:
            order = np.argsort(ahead)
            rows = np.arange(ahead.min(), ahead.max(), _STEP_M)
            found.append(np.array([rows, np.interp(rows, ahead[order], left[order])]))
    found.sort(key=lambda line: float(np.ptp(line[0])), reverse=True)
    return found[:_MOST_LINES]


def _surface(profile: RoadProfile, place_m: _F64) -> GroundSurface:
    """Return the surface of a profile: places of flat ground move along rays from the camera."""
    scale = profile.scale(profile.knots_m)
    x = place_m[0] + scale * profile.knots_m
    rising = np.append(True, np.diff(np.maximum.accumulate(x)) > _LEAST_PIECE_M)
    x, z = x[rising], (place_m[2] * (1 - scale))[rising]
    steep = np.abs(np.diff(z) / np.diff(x)) > _STEEPEST
    if steep[1:].any():  # the edge of a car far ahead was taken for a line
        last = int(steep[1:].argmax()) + 2
        x, z = x[:last], z[:last]
    spread = np.hypot(_SD_M, _GRADE_SD * np.maximum(x - place_m[0], 0.0))
    surface = GroundSurface(x_m=x, z_m=z, sd_m=spread, source="lines")
    rise = float(surface.profile(np.array([place_m[0] + _TOLD_M]))[0]) / _TOLD_M
    note = (
        "The road is taken as its lines in the image are parallel: against the camera's pitch in "
        f"the rig it rises by {np.degrees(np.arctan(rise)):.1f} deg over {_TOLD_M:.0f} m."
    )
    return replace(surface, notes=(note,))
