"""Lines in the bird's-eye view: second-order polynomials through evidence of paint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.lanes.config import LaneConfig
from percept.lanes.road_grid import RoadGrid

__all__ = ["PaintLine", "fit_line", "gather_paint", "line_through", "nearness", "without_doubles"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_REACH_ACROSS_M = 0.35
_SHORT_M = 8.0  # a line seen over less is taken for straight
_STEEPEST = 0.25
_STEEPEST_NEAR = 0.1  # against the road's direction, which the vanishing point gives
_NEAR_M = 20.0  # more than a period of dashes: a line of this road begins within it
_NEAR_PAINT_M = 0.8
_HALF_M = 20.0  # at which paint counts half
_TIGHTEST = 1 / 50.0  # 1/m
_CLEAR = 0.4  # evidence from which a row shows paint
_ROUNDS = 6
_ALIGNED_M = 0.06
_USUAL_BEND = 1 / 400  # 1/m, of half the curvature
_PRIOR_POINTS = 10.0
_SAME_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class PaintLine:
    """A line y(x) in the road's frame and the paint that it was fitted to.

    Attributes:
        polynomial: (3,) float64 of y = p0 + p1 x + p2 x^2.
        rows: (K,) int64 rows of the grid that show its paint.
        x_m: (K,) float64 of these rows.
        y_m: (K,) float64 middle of the paint in them.
        strength: (K,) float64 evidence 0..1.
        spread_m: Root mean square of the middles about the polynomial, near ones above all.
    """

    polynomial: _F64
    rows: NDArray[np.int64]
    x_m: _F64
    y_m: _F64
    strength: _F64
    spread_m: float

    def at(self, x_m: _F64) -> _F64:
        """Return y of places along the road."""
        p = self.polynomial
        y: _F64 = p[0] + p[1] * x_m + p[2] * x_m**2
        return y

    def paint_m(self, grid: RoadGrid) -> float:
        """Return the length of its paint."""
        return len(self.rows) * grid.step_m

    @property
    def weight(self) -> float:
        """How much near, clear and well aligned paint it has; clutter is not aligned."""
        paint = float((self.strength * nearness(self.x_m)).sum())
        return paint * float(np.exp(-((self.spread_m / _ALIGNED_M) ** 2)))


def fit_line(x_m: _F64, y_m: _F64, weights: _F64, *, scale_m: float) -> _F64:
    """Return the polynomial (3,) that most points lie on, by reweighted least squares.

    Weights fall as Geman and McClure's with the distance over `scale_m`, which grows with range,
    and with the square of range: a row of pixels far away shows more road. Where the points
    cover a short stretch the line is straight; a weak prior keeps curvature off what few show.
    """
    design = np.column_stack([np.ones_like(x_m), x_m / 10, (x_m / 10) ** 2])
    length = float(np.ptp(x_m))
    if length < _SHORT_M:
        design = design[:, :2]
    # A bend as tight as `_USUAL_BEND` weighs as so many points that are `scale_m` off.
    stiff = _PRIOR_POINTS * (scale_m / (100 * _USUAL_BEND)) ** 2
    prior = np.diag([0.0, 0.0, stiff][: design.shape[1]])
    robust: _F64 = np.ones(len(x_m), dtype=np.float64)
    solution: _F64 = np.zeros(design.shape[1], dtype=np.float64)
    for _ in range(_ROUNDS):
        w = weights * robust * nearness(x_m) ** 2
        normal = (design * w[:, None]).T @ design + prior + 1e-9 * np.eye(len(solution))
        solution = np.asarray(np.linalg.solve(normal, (design * w[:, None]).T @ y_m))
        off = (y_m - design @ solution) / (scale_m / np.sqrt(nearness(x_m)))
        robust = 1 / (1 + off**2) ** 2
    polynomial = np.zeros(3, dtype=np.float64)
    polynomial[: len(solution)] = solution
    return polynomial / [1.0, 10.0, 100.0]


def nearness(x_m: _F64) -> _F64:
    """Return the weight 0..1 of places ahead: a pixel far away shows more road, and more cars."""
    weight: _F64 = 1 / (1 + (x_m / _HALF_M) ** 2)
    return weight


def line_through(
    course_m: _F64, evidence: _F32, grid: RoadGrid, config: LaneConfig
) -> PaintLine | None:
    """Gather the paint beside a course, and fit a line to it; None where it is no line.

    Args:
        course_m: (rows,) float64 y of the course in each row of the grid.
        evidence: (rows, columns) float32 0..1 on the grid.
        grid: The grid.
        config: Settings.
    """
    reach = _REACH_ACROSS_M
    line = gather_paint(course_m, evidence, grid, reach)
    for _ in range(2):
        if line.paint_m(grid) < config.min_paint_m:
            return None
        reach = max(0.2, reach - 0.1)
        line = gather_paint(line.at(grid.x_m), evidence, grid, reach)
    return line if line.paint_m(grid) >= config.min_paint_m and _is_line(line, grid) else None


def gather_paint(course_m: _F64, evidence: _F32, grid: RoadGrid, reach_m: float) -> PaintLine:
    """Return the paint beside a course, and the polynomial through it; perhaps there is none.

    Args:
        course_m: (rows,) float64 y of the course in each row of the grid.
        evidence: (rows, columns) float32 0..1 on the grid.
        grid: The grid.
        reach_m: How far to either side.
    """
    half = grid.cells(reach_m)
    middle = np.round(grid.column(course_m)).astype(np.int64)
    columns = middle[:, None] + np.arange(-half, half + 1)
    valid = (columns >= 0) & (columns < len(grid.y_m))
    clipped = np.clip(columns, 0, len(grid.y_m) - 1)
    near = np.where(valid, np.take_along_axis(evidence, clipped, axis=1), 0).astype(np.float64)
    mass = near.sum(axis=1)
    middles = (near * grid.y_m[clipped]).sum(axis=1) / np.maximum(mass, 1e-9)
    peak = near.max(axis=1)
    rows = np.flatnonzero(peak >= _CLEAR)
    x_m, y_m, strength = grid.x_m[rows], middles[rows], peak[rows]
    if not len(rows):
        return PaintLine(np.zeros(3), rows, x_m, y_m, strength, np.inf)
    p = fit_line(x_m, y_m, strength, scale_m=0.1)
    off = y_m - (p[0] + p[1] * x_m + p[2] * x_m**2)
    spread = float(np.sqrt(np.average(off**2, weights=nearness(x_m))))
    return PaintLine(p, rows, x_m, y_m, strength, spread)


def _is_line(line: PaintLine, grid: RoadGrid) -> bool:
    p = line.polynomial
    ends = np.abs(p[1] + 2 * p[2] * line.x_m[[0, -1]])
    near = int((line.x_m < grid.x_m[0] + _NEAR_M).sum()) * grid.step_m
    return bool(
        near >= _NEAR_PAINT_M
        and abs(p[1] + 2 * p[2] * grid.x_m[0]) < _STEEPEST_NEAR
        and ends.max() < _STEEPEST
        and abs(2 * p[2]) < _TIGHTEST
        and line.spread_m < 0.2
    )


def without_doubles(lines: Sequence[PaintLine]) -> list[PaintLine]:
    """Return lines, those with most paint nearby first, without those that lie on another one."""
    kept: list[PaintLine] = []
    for line in sorted(lines, key=lambda line: -line.weight):
        if all(_apart(line, other) > _SAME_M for other in kept):
            kept.append(line)
    return kept


def _apart(line: PaintLine, other: PaintLine) -> float:
    """Return the least distance of two lines where the first one has paint."""
    return float(np.abs(line.y_m - other.at(line.x_m)).min())
