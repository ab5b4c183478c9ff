"""Lines and stop lines of the lane in one image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.lane_markings import LaneDetections, LaneLine, StopLineSeen
from percept.core.rig import CameraSensor
from percept.lanes.bars import find_bars_across
from percept.lanes.config import LaneConfig
from percept.lanes.described import (
    Course,
    Scene,
    course_of,
    describe_bar,
    describe_line,
)
from percept.lanes.ego_lane import choose_lane
from percept.lanes.ground import flat_ground
from percept.lanes.ground_image import ground_from_image
from percept.lanes.hough import follow_segments
from percept.lanes.lines import PaintLine, line_through, without_doubles
from percept.lanes.paint_config import PaintConfig
from percept.lanes.paint_mask import lightness, paint_evidence, yellowness
from percept.lanes.pose_of_view import PlacedView, place_view
from percept.lanes.road_grid import RoadGrid
from percept.lanes.windows import follow_windows

__all__ = ["PaintMask", "detect_lanes"]

PaintMask = Callable[[NDArray[np.uint8]], NDArray[np.float32]]

_U8 = NDArray[np.uint8]
_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]

_BLUR_PX = 1.0
_USUAL_WIDTH_M = 3.5
_SCALE_DOUBT = 1.6  # of a camera whose height is assumed
_CLEARLY = 1.2  # how far inside of its bounds a width is, to be taken for a lane's
_LEAST_OTHER = 0.3  # confidence
_CROSSED = 0.75  # of the lane's width, by a stop line
_BAR_CONTRAST = 1.0  # of that of a line
_LEAST_REACH_M = 10.0
_SHAPE = PaintConfig(reach_m=30.0)  # of the road: far dashes tell it too


def detect_lanes(
    image: _U8,
    camera: CameraSensor | None = None,
    config: LaneConfig | None = None,
    *,
    paint_mask: PaintMask | None = None,
) -> LaneDetections:
    """Find the lines of the lane, other lines of the road, and stop lines.

    With a camera on a rig the result is in metres in the vehicle's frame; with intrinsics alone
    and `camera_height_m`, in metres from below the camera along its axis. Else it is in pixels. The
    bird's-eye view comes from the rig or from the vanishing point of the image itself.

    Args:
        image: (H, W, 3) uint8 BGR, as recorded.
        camera: The camera, if known.
        config: Settings.
        paint_mask: Takes the place of the classical mask: returns (H, W) float32 0..1 of an
            image, such as that of a network.

    Raises:
        GeometryError: If the image is none, has not the size of the camera's images, or the
            camera cannot see the road.
    """
    settings = config or LaneConfig()
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or min(image.shape) < 1:
        raise GeometryError(f"an image is (H, W, 3) uint8, not {image.shape} {image.dtype}")
    gray = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    placed = place_view(gray, camera, settings)
    if placed is None:
        return LaneDetections(
            lines=(), notes=("no lines were found: nothing in the image meets in one point",)
        )
    mask = None if paint_mask is None else _checked(paint_mask(image), image)
    return _detected(image, mask, placed, settings)


def _checked(mask: _F32, image: _U8) -> _U8:
    """Return a mask of 0..1 as grey levels, which is what the bird's-eye view takes."""
    if mask.shape != image.shape[:2]:
        raise GeometryError(f"the mask is {mask.shape} and the image {image.shape[:2]}")
    return np.asarray(np.clip(mask, 0, 1) * 255, dtype=np.uint8)


def _detected(
    image: _U8, mask: _U8 | None, placed: PlacedView, config: LaneConfig
) -> LaneDetections:
    """Return what an image shows."""
    ground = flat_ground()
    if placed.metric:
        ground = ground_from_image(image, placed.camera, _SHAPE)
        notes = (*placed.notes, *(ground.notes if ground.source == "flat" else ()))
        bend = float(np.arctan(ground.grade(ground.x_m[:1])[0]))
        placed = replace(placed, notes=notes, pitch_rad=placed.pitch_rad + bend)
        # Beyond the last paint that told the road's shape nothing tells where a pixel is.
        told_m = max(float(ground.x_m[-1]), _LEAST_REACH_M)
        config = config.model_copy(update={"reach_m": min(config.reach_m, told_m)})
    grid = RoadGrid.over(placed.camera, ground, config)
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR_PX), dtype=np.uint8)
    seen = _Seen.on(grid, smooth, mask, config, whole=placed.metric)
    lines = seen.lines(config)
    left, right = choose_lane(lines, grid, _width_bounds(placed, config))
    # Details are looked at without the blur: two lines of a pair are a few pixels apart.
    sharp = grid.warped(image)
    scene = Scene(image, placed, grid, lightness(sharp), yellowness(sharp), config)
    return _told(scene, lines, left, right)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The image on a grid."""

    grid: RoadGrid
    light: _F32
    yellow: _F32
    evidence: _F32
    channels: tuple[_F32, ...]

    @classmethod
    def on(
        cls, grid: RoadGrid, smooth: _U8, mask: _U8 | None, config: LaneConfig, *, whole: bool
    ) -> _Seen:
        warped = grid.warped(smooth)
        light, yellow = lightness(warped), yellowness(warped)
        if mask is None:
            evidence = paint_evidence(warped, grid, config, whole=whole)
            return cls(grid, light, yellow, evidence, (light, yellow))
        evidence = (np.where(grid.inside, grid.warped(mask), 0) / 255).astype(np.float32)
        return cls(grid, light, yellow, evidence, (evidence,))

    def lines(self, config: LaneConfig) -> list[PaintLine]:
        """Return lines by the method of the settings."""
        if config.method == "windows":
            courses = follow_windows(self.evidence, self.grid)
        else:
            courses = follow_segments(self.channels, self.evidence, self.grid, config)
        found = [line_through(c, self.evidence, self.grid, config) for c in courses]
        return without_doubles([line for line in found if line is not None])


def _width_bounds(placed: PlacedView, config: LaneConfig) -> tuple[float, float]:
    low, high = config.lane_width_m
    return (low, high) if placed.metric else (low / _SCALE_DOUBT, high * _SCALE_DOUBT)


def _told(
    scene: Scene, lines: list[PaintLine], left: PaintLine | None, right: PaintLine | None
) -> LaneDetections:
    """Describe lines; a line of the lane that is not there is placed by the lane's width."""
    courses = {id(line): course_of(line) for line in lines}
    described = [
        describe_line(_side(line, left, right), courses[id(line)], line, scene) for line in lines
    ]
    kept = [line for line in described if line.side != "other" or line.confidence >= _LEAST_OTHER]
    notes = list(scene.placed.notes)
    if len(kept) < len(described):
        notes.append(f"left out beside the lane: {len(described) - len(kept)} faint lines")
    guessed = _completed(scene, left, right, courses, lines, notes)
    width = None
    if scene.placed.metric and left is not None and right is not None:
        width = float(_true_width(courses[id(left)], courses[id(right)], scene.grid))
    bars = _stop_lines(scene, left, right, courses)
    order = {"left": 0, "right": 1, "other": 2}
    told = sorted([*kept, *guessed], key=lambda line: order[line.side])
    return LaneDetections(
        lines=tuple(told),
        stop_lines=bars,
        lane_width_m=width,
        pitch_rad=scene.placed.pitch_rad,
        notes=tuple(notes),
    )


def _side(line: PaintLine, left: PaintLine | None, right: PaintLine | None) -> str:
    return "left" if line is left else "right" if line is right else "other"


def _true_width(left: Course, right: Course, grid: RoadGrid) -> float:
    near = grid.x_m[:1]
    slope = (left.polynomial[1] + right.polynomial[1]) / 2
    return float((left.at(near) - right.at(near))[0] * np.cos(np.arctan(slope)))


def _completed(
    scene: Scene,
    left: PaintLine | None,
    right: PaintLine | None,
    courses: dict[int, Course],
    lines: list[PaintLine],
    notes: list[str],
) -> list[LaneLine]:
    """Return the line that is missing, beside the one that is there; note what is missing."""
    if left is None and right is None:
        notes.append("left and right line were not found")
        return []
    if left is not None and right is not None:
        return []
    side, there, sign = ("right", left, -1) if right is None else ("left", right, 1)
    if there is None:
        return []
    width, source = _likely_width(scene, there, -sign, lines)
    course = courses[id(there)]
    moved = course.polynomial + np.array([sign * width, 0.0, 0.0])
    notes.append(
        f"the {side} line was not found: it is placed beside the other one by a width of "
        f"{width:.2f} m, {source}"
    )
    return [
        describe_line(side, Course(moved, course.end_m, guessed=True), None, scene),
    ]


def _likely_width(
    scene: Scene, there: PaintLine, outwards: int, lines: list[PaintLine]
) -> tuple[float, str]:
    """Return the width of the lane beyond the line that is there, or a usual one."""
    near = scene.grid.x_m[:1]
    low, high = _width_bounds(scene.placed, scene.config)
    beyond = [outwards * float((line.at(near) - there.at(near))[0]) for line in lines]
    fits = [w for w in beyond if _CLEARLY * low <= w <= high / _CLEARLY]
    if fits:
        return min(fits), "that of the next lane"
    return _USUAL_WIDTH_M, "which is usual"


def _stop_lines(
    scene: Scene,
    left: PaintLine | None,
    right: PaintLine | None,
    courses: dict[int, Course],
) -> tuple[StopLineSeen, ...]:
    """Return stop lines between the lines of the lane; a half lane each side without them."""
    grid = scene.grid
    sides = []
    for line, sign in ((left, 1), (right, -1)):
        if line is None:
            sides.append(np.full(len(grid.x_m), grid.eye_m[1] + sign * _USUAL_WIDTH_M / 2))
        else:
            sides.append(courses[id(line)].at(grid.x_m))
    paint = PaintConfig(
        contrast=max(_BAR_CONTRAST * scene.config.contrast, 0.01),
        bar_widths_m=scene.config.stop_line_width_m,
    )
    bars = zip(
        *find_bars_across(grid.view, grid.view.image(scene.image), grid.view.seen, paint),
        strict=True,
    )
    return tuple(
        describe_bar(ends, extent, spread, scene)
        for ends, extent, spread in bars
        if _crosses(ends, sides[0], sides[1], grid)
    )


def _crosses(ends_m: _F64, left_m: _F64, right_m: _F64, grid: RoadGrid) -> bool:
    """Return whether a bar (2, 2), left end first, crosses most of the lane."""
    at = float(ends_m[:, 0].mean())
    left, right = (float(np.interp(at, grid.x_m, side)) for side in (left_m, right_m))
    shared = min(left, float(ends_m[0, 1])) - max(right, float(ends_m[1, 1]))
    return shared >= _CROSSED * (left - right)
