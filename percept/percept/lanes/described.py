"""From a line in the bird's-eye view to what is told of it: places, type, colour, spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import LaneLine, StopLineSeen
from percept.lanes.colour import line_colour
from percept.lanes.config import LaneConfig
from percept.lanes.line_type import LineStrip, line_strip, line_type, pair_of
from percept.lanes.lines import PaintLine
from percept.lanes.pose_of_view import PlacedView
from percept.lanes.road_grid import RoadGrid

__all__ = ["Course", "Scene", "course_of", "describe_bar", "describe_line"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_STEP_M = 0.5  # of the points of a line
_FAR_M = 150.0
_BESIDE_M = 0.15
_SMOOTH_M = 2.0
_WELL_PLACED_M = 20.0
_PIXEL_SD = 0.3  # of the middle of a line
_FIT_SD_M = 0.01
_GUESSED_SD_M = 0.3  # of a lane's width that is taken from elsewhere
_GUESSED_CONFIDENCE = 0.1
_SURE_STOP_M = 0.3  # spread up to which a stop line is beyond doubt
_FULL_PAINT_M = 6.0  # near the vehicle, from which a line is beyond doubt


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One image as lines are described in it.

    Attributes:
        image: (H, W, 3) uint8 BGR, as recorded.
        placed: The camera over the road, and how the road lies to the vehicle.
        grid: The bird's-eye view.
        light: (rows, columns) float32 logarithmic lightness on the grid.
        yellow: (rows, columns) float32 yellowness.
        config: Settings.
    """

    image: NDArray[np.uint8]
    placed: PlacedView
    grid: RoadGrid
    light: _F32
    yellow: _F32
    config: LaneConfig


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Where a line is on the road: y(x) in the road's frame; straight after its paint.

    Attributes:
        polynomial: (3,) float64.
        end_m: x of its last paint.
        guessed: Whether it is where a line should be, not where paint was seen.
    """

    polynomial: _F64
    end_m: float
    guessed: bool = False

    def at(self, x_m: _F64) -> _F64:
        """Return y."""
        p = self.polynomial
        bent = np.minimum(x_m, self.end_m)
        straight = np.maximum(x_m - self.end_m, 0.0) * (p[1] + 2 * p[2] * self.end_m)
        y: _F64 = p[0] + p[1] * bent + p[2] * bent**2 + straight
        return y


def course_of(line: PaintLine) -> Course:
    """Return the course of a line."""
    return Course(line.polynomial, float(line.x_m[-1]))


def describe_line(side: str, course: Course, line: PaintLine | None, scene: Scene) -> LaneLine:
    """Return a line as it is told; `line` is its paint, None where there is none."""
    colour, kind, paint_width, shift = "unknown", "unknown", np.nan, 0.0
    if line is not None:
        colour, kind, paint_width, shift = _attributes(line, scene)
    points = _places(course, line, scene) + np.array([0.0, shift])
    pixels = scene.grid.view.pixels(points)[0]
    seen = np.isfinite(pixels).all(axis=1)
    size = np.array(scene.placed.camera.image_size)
    with np.errstate(invalid="ignore"):
        seen &= (pixels > -size).all(axis=1) & (pixels < 2 * size.max()).all(axis=1)
    points, pixels = points[seen], pixels[seen]
    metric = scene.placed.metric
    return LaneLine(
        side=side,
        points_px=pixels,
        points_m=scene.placed.to_vehicle(points) if metric else np.zeros((0, 2)),
        sd_m=_spread(points, course, scene) if metric else np.zeros(0),
        colour=colour,
        type=kind,
        width_m=paint_width if metric else np.nan,
        confidence=_GUESSED_CONFIDENCE if line is None else _confidence(line, scene),
    )


def _places(course: Course, line: PaintLine | None, scene: Scene) -> _F64:
    """Return points (K, 2) of a course on the road.

    Nearby, where paint is placed well, the course goes through its middle.
    """
    first = float(scene.grid.x_m[0])
    last = max(course.end_m, first + 2 * _STEP_M)
    x = np.arange(first, last + 1e-6, _STEP_M)
    if not scene.placed.metric:
        # There is no spread to tell how far a line can be believed: it goes on to the horizon.
        x = np.concatenate([x, np.geomspace(last + 1, max(_FAR_M, last + 2), 20)])
    y = course.at(x)
    if line is not None:
        y = y + _beside(course, line, scene, x)
    return np.column_stack([x, y])


def _beside(course: Course, line: PaintLine, scene: Scene, x_m: _F64) -> _F64:
    """Return by how much paint lies beside its course (K,), smoothed along the line."""
    off = line.y_m - course.at(line.x_m)
    usable = np.abs(off) < _BESIDE_M
    apart = (x_m[:, None] - line.x_m[usable]) / _SMOOTH_M
    kernel = np.exp(-0.5 * apart**2)
    # As if a metre of paint had been seen on the course itself.
    moved = (kernel * off[usable]).sum(axis=1) / (kernel.sum(axis=1) + 1 / scene.grid.step_m)
    ahead = x_m - scene.grid.eye_m[0]
    near: _F64 = moved * np.clip((_WELL_PLACED_M - ahead) / (0.5 * _WELL_PLACED_M), 0, 1)
    return near


def _attributes(line: PaintLine, scene: Scene) -> tuple[str, str, float, float]:
    """Return colour, type, width of the paint, and how far left of the line its middle is."""
    light = line_strip(line, scene.light, scene.grid)
    yellow = line_strip(line, scene.yellow, scene.grid)
    clearer = max(light, yellow, key=lambda strip: _usual(strip))
    pair = pair_of(light, yellow)
    places = pair or (0.0,)
    colour = line_colour(light, yellow, places, scene.config.contrast)
    width = _paint_width(clearer, places[0])
    shift = 0.0 if pair is None else (pair[0] + pair[1]) / 2
    return colour, line_type(clearer, pair), width, shift


def _usual(strip: LineStrip) -> float:
    middle = np.abs(strip.offset_m) < 0.1
    return float(np.percentile(strip.contrast[:, middle].max(axis=1), 70))


def _paint_width(strip: LineStrip, offset_m: float) -> float:
    """Return the width over half of the contrast of the paint about an offset."""
    rows = strip.sharp & strip.inside
    if not rows.any():
        return float("nan")
    middle = np.abs(strip.offset_m - offset_m) < 0.05
    clear = strip.contrast[:, middle].max(axis=1)
    rows &= clear >= 0.7 * np.percentile(clear[rows], 85)
    if not rows.any():
        return float("nan")
    across = np.median(strip.contrast[rows], axis=0)
    k = int(np.argmin(np.abs(strip.offset_m - offset_m)))
    level = across[k] / 2
    low, high = k, k
    while low > 0 and across[low - 1] > level:
        low -= 1
    while high < len(across) - 1 and across[high + 1] > level:
        high += 1
    return float(strip.offset_m[low] - strip.offset_m[high]) + abs(
        float(strip.offset_m[1] - strip.offset_m[0])
    )


def _spread(points_m: _F64, course: Course, scene: Scene) -> _F64:
    """Return the spread (K,) across the line: of its pixels, and of the road's pitch."""
    place = scene.grid.eye_m
    ahead, across = (points_m - place[:2]).T
    pixel = _PIXEL_SD * ahead / scene.grid.focal_px[0]
    pitch = np.abs(across) * ahead / place[2] * np.radians(scene.config.pitch_sd_deg)
    guessed = _GUESSED_SD_M if course.guessed else 0.0
    spread: _F64 = np.sqrt(_FIT_SD_M**2 + pixel**2 + pitch**2 + guessed**2)
    return spread


def _confidence(line: PaintLine, scene: Scene) -> float:
    return min(1.0, line.weight * scene.grid.step_m / _FULL_PAINT_M)


def describe_bar(ends_m: _F64, extent_m: float, sd_m: float, scene: Scene) -> StopLineSeen:
    """Return a stop line as it is told.

    Args:
        ends_m: (2, 2) ends of its near edge, left then right.
        extent_m: Along the road.
        sd_m: Spread of its near edge along the road.
        scene: Where it was seen.
    """
    metric = scene.placed.metric
    away = float(ends_m[:, 0].mean() - scene.grid.eye_m[0])
    pitch = away**2 / float(scene.grid.eye_m[2]) * np.radians(scene.config.pitch_sd_deg)
    spread = float(np.hypot(sd_m, pitch))
    return StopLineSeen(
        points_px=scene.grid.view.pixels(ends_m)[0],
        points_m=scene.placed.to_vehicle(ends_m) if metric else np.full((2, 2), np.nan),
        distance_m=float(ends_m[:, 0].mean()) if metric else np.nan,
        sd_m=spread if metric else np.nan,
        width_m=extent_m if metric else np.nan,
        confidence=float(np.clip(_SURE_STOP_M / spread, 0.2, 1.0)),
    )
