"""Paint on the road as one look at it shows: lines and bars, and where was looked at all.

Words for types and colours are those of Lanelet2 (its LinestringTagging): `solid`, `dashed`,
`solid_solid`, `solid_dashed`, `dashed_solid`, `white`, `yellow`; or `unknown`. Of a pair the
first word is the line on the left in the direction of the points.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = [
    "LINE_TYPES",
    "GroundCoverage",
    "LaneDetections",
    "LaneLine",
    "PaintObservation",
    "Sight",
    "StopLineSeen",
]

_F64 = NDArray[np.float64]

LINE_TYPES = frozenset({"solid", "dashed", "solid_solid", "solid_dashed", "dashed_solid"})
"""Types of lines that are known; `unknown` is none of them."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LaneLine:
    """One line of paint in one image.

    Attributes:
        side: `left` and `right` bound the lane that the vehicle is in; `other` does not.
        points_px: (K, 2) float64 u, v in the recorded image, from near to far.
        points_m: (K, 2) float64 x forward, y left in the vehicle's frame, on the ground;
            (0, 2) where no camera was given.
        sd_m: (K,) float64 spread of each point across the line; (0,) without a camera.
        colour: `white`, `yellow` or `unknown`.
        type: `solid`, `dashed`, `solid_solid`, `solid_dashed`, `dashed_solid` or `unknown`.
        width_m: Width of the paint (of one line of a pair); NaN without a camera.
        confidence: 0..1.
    """

    side: str
    points_px: _F64
    points_m: _F64
    sd_m: _F64
    colour: str
    type: str
    width_m: float
    confidence: float

    def __post_init__(self) -> None:
        placed = len(self.points_m)
        if placed not in (0, len(self.points_px)) or len(self.sd_m) != placed:
            raise GeometryError("the points of a line in pixels and in metres are not the same")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StopLineSeen:
    """A bar of paint across the lane.

    Attributes:
        points_px: (2, 2) float64 ends of its near edge in the recorded image, left then right.
        points_m: (2, 2) float64 the same on the ground in the vehicle's frame; NaN without a
            camera.
        distance_m: From the vehicle's origin to its near edge along the lane.
        sd_m: Spread of that distance.
        width_m: Extent of the bar along the lane.
        confidence: 0..1.
    """

    points_px: _F64
    points_m: _F64
    distance_m: float
    sd_m: float
    width_m: float
    confidence: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LaneDetections:
    """Lines and stop lines in one image.

    Attributes:
        lines: Left and right line of the lane where they are found, and others.
        stop_lines: Stop lines, the nearest first.
        lane_width_m: Between left and right line at the vehicle; None where one of them, or the
            scale, is not known.
        pitch_rad: By how much the camera's pitch was corrected; 0 where it was not.
        notes: What a reader should know, as sentences: why a line was not found among them.
    """

    lines: tuple[LaneLine, ...]
    stop_lines: tuple[StopLineSeen, ...] = ()
    lane_width_m: float | None = None
    pitch_rad: float = 0.0
    notes: tuple[str, ...] = ()

    def line(self, side: str) -> LaneLine | None:
        """Return the line of a side, or None."""
        return next((line for line in self.lines if line.side == side), None)


class Sight(IntEnum):
    """Why a place on the ground could be looked at, or could not."""

    SEEN = 0
    OUT_OF_VIEW = 1
    OCCLUDED = 2
    TOO_FAR = 3
    TOO_DARK = 4


@dataclass(frozen=True, slots=True, eq=False)
class GroundCoverage:
    """Which places around the vehicle were looked at, as a grid on the ground.

    Attributes:
        corner_m: x and y of the first cell's corner in the vehicle's frame.
        cell_m: Side of a cell.
        sights: (rows along x, columns along y) uint8 of `Sight`.
    """

    corner_m: tuple[float, float]
    cell_m: float
    sights: NDArray[np.uint8]

    def at(self, points_m: _F64) -> NDArray[np.uint8]:
        """Return the `Sight` (N,) of points (N, 2) in the vehicle's frame."""
        places = np.floor((points_m - np.asarray(self.corner_m)) / self.cell_m)
        inside = ((places >= 0) & (places < self.sights.shape)).all(axis=1)
        rows, columns = np.where(inside[:, None], places, 0).astype(np.intp).T
        found: NDArray[np.uint8] = np.where(
            inside, self.sights[rows, columns], np.uint8(Sight.OUT_OF_VIEW)
        )
        return found


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PaintObservation:
    """All paint that one look (an image, or a sweep of a LiDAR) shows, unsorted.

    A stroke is a short piece of a line: one cross-section of paint. A pair of lines gives two
    strokes beside each other. A bar is paint across the road.

    Attributes:
        stamp_ns: Time of the look.
        sensor: Name of the camera or LiDAR.
        frame_id: The vehicle's frame, x forward, y left, z up; all metres are in it.
        strokes_m: (N, 3) float64 middles of strokes on the ground.
        direction_rad: (N,) float64 directions of the lines that they belong to, from +x,
            within -pi/2 ... pi/2.
        width_m: (N,) float64 widths of the paint.
        sd_m: (N,) float64 spreads of the middles across their lines, growing with range.
        yellow: (N,) float64 0 white ... 1 yellow; NaN where colour cannot be told.
        strength: (N,) float64 contrast of the paint against the road, 0..1.
        step_m: Distance along a line for which one stroke stands.
        bars_m: (B, 2, 2) float64 ends (x, y) of the near edges of bars, left then right.
        bar_width_m: (B,) float64 extents of the bars along the road.
        bar_sd_m: (B,) float64 spreads of the near edges along the road.
        coverage: Where paint would have been seen.
        lines_only: Only that a line is there is told: neither are bars looked for, nor can one
            line be told from a pair.
        notes: What was not normal, as sentences.

    Raises:
        GeometryError: If columns do not have one length.
    """

    stamp_ns: int
    sensor: str
    frame_id: str
    strokes_m: _F64
    direction_rad: _F64
    width_m: _F64
    sd_m: _F64
    yellow: _F64
    strength: _F64
    step_m: float
    coverage: GroundCoverage
    bars_m: _F64 = field(default_factory=lambda: np.zeros((0, 2, 2)))
    bar_width_m: _F64 = field(default_factory=lambda: np.zeros(0))
    bar_sd_m: _F64 = field(default_factory=lambda: np.zeros(0))
    lines_only: bool = False
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        strokes = (self.direction_rad, self.width_m, self.sd_m, self.yellow, self.strength)
        if self.strokes_m.shape != (len(self.strokes_m), 3) or any(
            len(column) != len(self.strokes_m) for column in strokes
        ):
            raise GeometryError("the columns of strokes do not have one length")
        if self.bars_m.shape != (len(self.bars_m), 2, 2) or not (
            len(self.bars_m) == len(self.bar_width_m) == len(self.bar_sd_m)
        ):
            raise GeometryError("the columns of bars do not have one length")
