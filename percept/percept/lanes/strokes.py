"""Strokes: short cross-sections of lines of paint in the view from above.

A line is a narrow ridge across its direction: brighter, or more yellow, than the road on both of
its sides (the symmetrical local threshold of Veit et al. 2008). Peaks of ridges in neighbouring
rows are linked to chains; a stroke is half a metre of a chain. What links to nothing is a speck.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lanes.birdseye import BirdsEye
from percept.lanes.paint_config import PaintConfig
from percept.lanes.paint_mask import lightness, yellowness

__all__ = ["Strokes", "find_strokes"]

_F64 = NDArray[np.float64]
_F32 = NDArray[np.float32]

_FLANK_M, _GAP_M = 0.1, 0.03
_AROUND_M = (6.0, 2.0)  # along and across: where the usual contrast is taken from
_LINK_M = (0.25, 0.07)  # along and across: peaks that are nearer are of one chain
_APART_M = 0.1  # lines that are nearer to each other are one
_BESIDE_M = 0.2
_ALONG_RAY, _CROSSED_AT = 0.08, 0.13  # radians; vehicles change lanes at less
_SHORTEST_M = 0.7
_DIRECTION_M = 2.0
_WIDEST_M = 0.4
_PIXEL_SD = 0.35
_FLOOR_SD_M = 0.01  # paint itself has no sharper edge
_STEEPEST = 1.0  # across over along: what leans more is no line along the road
_LIKELY, _SUREST = 0.5, 0.999999  # of a mask: from where it is paint, and where it is capped
_MASK_SD_M = 0.06
_YELLOW, _YELLOW_SD = 0.22, 0.05  # logarithm of red and green over blue, against the road beside


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Strokes:
    """Strokes in the vehicle's frame; see `percept.core.lane_markings.PaintObservation`.

    Attributes:
        chain: (N,) int64 which strokes hang together.
    """

    points_m: _F64
    direction_rad: _F64
    width_m: _F64
    sd_m: _F64
    yellow: _F64
    strength: _F64
    chain: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Peaks:
    """Peaks of ridges: one a row and line, at fractions of columns."""

    rows: NDArray[np.intp]
    columns: _F64
    widths: _F64
    contrast: _F64
    yellow: _F64


def find_strokes(
    view: BirdsEye,
    warped: NDArray[np.uint8],
    config: PaintConfig,
    mask: NDArray[np.uint8] | None = None,
) -> Strokes:
    """Return the strokes of a view from above.

    Args:
        view: The view.
        warped: (rows, columns, 3) uint8 BGR, the image in it.
        config: Settings.
        mask: (rows, columns) uint8 0..255 in the same view: how likely it is that a cell is
            paint. It takes the place of contrast; colour is still that of the image.
    """
    peaks = _peaks(view, warped, config) if mask is None else _of_mask(view, warped, mask, config)
    chains = _chains(peaks, view)
    return _as_strokes(peaks, chains, view, config)


def _peaks(view: BirdsEye, warped: NDArray[np.uint8], config: PaintConfig) -> _Peaks:
    """Find where each row is a ridge: above both sides, above the usual, and the highest there."""
    grid = view.grid
    light, yellow = lightness(warped), yellowness(warped)
    by_light, by_yellow = (_contrast(values, view, config) for values in (light, yellow))
    # Cameras and JPEG keep colour coarsely: it counts where lightness shows nothing.
    beside = 2 * round(_BESIDE_M / grid.across_m) + 1
    near_light = cv2.dilate(by_light, np.ones((1, beside), np.uint8)) > 0
    best = np.asarray(np.where(near_light, by_light, by_yellow), np.float32)
    across, _ = view.footprint_m
    is_peak = _is_highest(best, grid.across_m) & (across <= config.coarsest_m)
    rows, columns = np.nonzero(is_peak)
    return _measured(light, yellow, rows, columns, best, near_light, grid.across_m)


def _of_mask(
    view: BirdsEye, warped: NDArray[np.uint8], mask: NDArray[np.uint8], config: PaintConfig
) -> _Peaks:
    """Find the middle of each run of paint in the rows of a mask.

    Smoothed, a run has one peak, whatever its width; the lines of a pair keep two.
    """
    cell_m = view.grid.across_m
    likely = np.asarray(mask / np.float32(255), np.float32)
    size = (2 * round(_WIDEST_M / 2 / cell_m) + 1, 1)
    smooth = cv2.GaussianBlur(likely, size, _MASK_SD_M / cell_m, None, 1e-3)
    contrast = -np.log1p(-np.minimum(smooth, _SUREST))
    best = np.asarray(np.where(likely >= _LIKELY, contrast, 0), np.float32)
    across, _ = view.footprint_m
    rows, columns = np.nonzero(_is_highest(best, cell_m) & (across <= config.coarsest_m))
    by_mask = np.ones(mask.shape, bool)
    return _measured(likely, yellowness(warped), rows, columns, best, by_mask, cell_m)


def _contrast(values: _F32, view: BirdsEye, config: PaintConfig) -> _F32:
    """Return by how much lines stand out of the road, 0 where there is none.

    The narrowest width that shows a line is taken: it tells the lines of a pair apart.
    """
    cell_m = view.grid.across_m
    found = np.zeros(values.shape, np.float32)
    for width_m in sorted(config.line_widths_m):
        ridge = _standing_out(_ridge(values, round(width_m / cell_m), cell_m), view, config)
        reach = 2 * round(_APART_M / cell_m) + 1
        known = cv2.dilate(found, np.ones((1, reach), np.uint8)) > 0
        found = np.asarray(np.where(known, found, ridge), np.float32)
    return found


def _is_highest(values: _F32, cell_m: float) -> NDArray[np.bool_]:
    """Return where values (rows, columns) are above 0 and the highest about them in their row."""
    reach = max(round(_APART_M / cell_m), 1)
    highest = cv2.dilate(values, np.ones((1, 2 * reach + 1), np.uint8))
    return np.asarray((values >= highest) & (values > 0), bool)


def _ridge(values: _F32, width: int, cell_m: float) -> _F32:
    """Return by how much a middle of `width` columns is above both of its sides, or below zero."""
    width = max(width, 1)
    side, gap = max(round(_FLANK_M / cell_m), 1), round(_GAP_M / cell_m)
    middle, flank = cv2.blur(values, (width, 1)), cv2.blur(values, (side, 1))
    shift = (width + 1) // 2 + gap + side // 2
    left, right = np.roll(flank, shift, axis=1), np.roll(flank, -shift, axis=1)
    found = np.asarray(middle - np.maximum(left, right), np.float32)
    found[:, :shift] = found[:, -shift:] = 0
    return found


def _standing_out(contrast: _F32, view: BirdsEye, config: PaintConfig) -> _F32:
    """Return the contrast where it is that of paint and stands out of what is usual, else 0."""
    size = (round(_AROUND_M[1] / view.grid.across_m), round(_AROUND_M[0] / view.grid.along_m))
    usual = cv2.blur(np.clip(np.abs(contrast), 0, config.contrast), size)
    least = np.maximum(config.contrast, config.noise * usual)
    return np.asarray(np.where(contrast > least, contrast, 0), np.float32)


def _measured(
    light: _F32,
    yellow: _F32,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    best: _F32,
    by_light: NDArray[np.bool_],
    cell_m: float,
) -> _Peaks:
    """Measure middle and width of each peak at half of its contrast, and its colour."""
    half = round(_WIDEST_M / cell_m)
    offsets = np.arange(-half, half + 1)
    around = np.clip(columns[:, None] + offsets, 0, light.shape[1] - 1)
    shown = np.maximum(light[rows[:, None], around], light[rows, columns][:, None] - 10.0).astype(
        np.float64
    )
    warm = yellow[rows[:, None], around].astype(np.float64)
    level = _half_level(shown, half, cell_m)
    use_warm = ~by_light[rows, columns]
    warm_level = _half_level(warm, half, cell_m)
    left = np.where(use_warm, warm_level.left, level.left)
    right = np.where(use_warm, warm_level.right, level.right)
    sides = _flank_mean(warm, left, right, offsets, cell_m)
    middle = (left + right) / 2
    tint = _inner_mean(warm, left, right, offsets) - sides
    return _Peaks(
        rows,
        columns + middle,
        (right - left) * cell_m,
        best[rows, columns].astype(np.float64),
        tint,
    )


@dataclass(frozen=True, slots=True)
class _HalfLevel:
    left: _F64
    right: _F64
    contrast: _F64


def _half_level(values: _F64, half: int, cell_m: float) -> _HalfLevel:
    """Return where profiles (N, 2 * half + 1) fall to the middle between peak and sides."""
    near = round(0.06 / cell_m)
    top = values[:, half - near : half + near + 1].max(axis=1)
    far = round(0.24 / cell_m)
    left_side = np.minimum.accumulate(values[:, half::-1], axis=1)[:, : far + 1].min(axis=1)
    right_side = np.minimum.accumulate(values[:, half:], axis=1)[:, : far + 1].min(axis=1)
    contrast = top - np.maximum(left_side, right_side)
    left = -_crossing(values[:, half::-1], (top + left_side) / 2)
    right = _crossing(values[:, half:], (top + right_side) / 2)
    return _HalfLevel(left, right, contrast)


def _crossing(values: _F64, level: _F64) -> _F64:
    """Return the first place, in columns, at which profiles (N, K) fall below a level (N,)."""
    below = values < level[:, None]
    first = np.where(below.any(axis=1), below.argmax(axis=1), values.shape[1] - 1)
    before = np.maximum(first - 1, 0)
    row = np.arange(len(values))
    high, low = values[row, before], values[row, first]
    share = np.clip((high - level) / np.maximum(high - low, 1e-9), 0.0, 1.0)
    crossing: _F64 = np.where(first > 0, before + share, 0.0)
    return crossing


def _inner_mean(values: _F64, left: _F64, right: _F64, offsets: NDArray[np.int64]) -> _F64:
    inner = (offsets >= left[:, None] - 0.01) & (offsets <= right[:, None] + 0.01)
    mean: _F64 = (values * inner).sum(axis=1) / np.maximum(inner.sum(axis=1), 1)
    return mean


def _flank_mean(
    values: _F64, left: _F64, right: _F64, offsets: NDArray[np.int64], cell_m: float
) -> _F64:
    """Return the mean of the road beside, on the side that is less yellow."""
    side, gap = _FLANK_M / cell_m, _GAP_M / cell_m + 1
    means = []
    for low, high in (
        (left - gap - side, left - gap),
        (right + gap, right + gap + side),
    ):
        flank = (offsets >= low[:, None]) & (offsets <= high[:, None])
        means.append((values * flank).sum(axis=1) / np.maximum(flank.sum(axis=1), 1))
    lower: _F64 = np.minimum(*means)
    return lower


def _chains(peaks: _Peaks, view: BirdsEye) -> NDArray[np.int32]:
    """Return the number (P,) of the chain of each peak."""
    grid = view.grid
    mask = np.zeros(grid.shape, np.uint8)
    columns = np.clip(np.rint(peaks.columns), 0, grid.shape[1] - 1).astype(np.intp)
    mask[peaks.rows, columns] = 1
    size = (max(round(_LINK_M[1] / grid.across_m), 1), max(round(_LINK_M[0] / grid.along_m), 1))
    grown = cv2.dilate(mask, np.ones((size[1] | 1, size[0] | 1), np.uint8))
    _, numbers = cv2.connectedComponents(grown, connectivity=8)
    found: NDArray[np.int32] = np.asarray(numbers, np.int32)[peaks.rows, columns]
    return found


def _as_strokes(
    peaks: _Peaks, chains: NDArray[np.int32], view: BirdsEye, config: PaintConfig
) -> Strokes:
    """Join the peaks of each half metre of a chain; leave out what is too short or too steep."""
    grid = view.grid
    places = grid.points(np.column_stack([peaks.rows, peaks.columns]))
    bins = np.floor(places[:, 0] / config.step_m).astype(np.int64)
    usable = peaks.widths <= _WIDEST_M
    key, inverse = np.unique(np.column_stack([chains, bins])[usable], axis=0, return_inverse=True)
    inverse = inverse.ravel()
    count = np.bincount(inverse, minlength=len(key))

    def mean(values: _F64) -> _F64:
        return np.bincount(inverse, values[usable], len(key)) / np.maximum(count, 1)

    x, y = mean(places[:, 0]), mean(places[:, 1])
    width = mean(peaks.widths)
    slope, length = _along_chains(key[:, 0], x, y)
    full = count >= 0.5 * config.step_m / grid.along_m
    keep = full & (length + config.step_m >= _SHORTEST_M) & (np.abs(slope) <= _STEEPEST)
    keep &= ~_is_upright(x - view.eye_m[0], y - view.eye_m[1], np.arctan(slope))
    x, y, slope = x[keep], y[keep], slope[keep]
    points = np.column_stack([x, y])
    z = view.ground.height(points)
    tint = mean(peaks.yellow)[keep]
    return Strokes(
        points_m=np.column_stack([points, z]),
        direction_rad=np.arctan(slope),
        width_m=width[keep] * np.cos(np.arctan(slope)),
        sd_m=_spread(points, view, config),
        yellow=1 / (1 + np.exp(-np.clip((tint - _YELLOW) / _YELLOW_SD, -30, 30))),
        strength=1 - np.exp(-mean(peaks.contrast)[keep]),
        chain=key[keep, 0],
    )


def _is_upright(ahead: _F64, left: _F64, direction: _F64) -> NDArray[np.bool_]:
    """Return which strokes look like upright edges: of cars, posts, barriers.

    On the ground such an edge falls on a ray from the foot of the camera. Lines of the road do so
    only where the camera crosses them, and then at a small angle.
    """
    ray = np.arctan2(left, ahead)
    along_ray = np.abs(ray - direction) < _ALONG_RAY
    return np.asarray(along_ray & (np.abs(direction) > _CROSSED_AT), bool)


def _along_chains(chain: NDArray[np.int64], x: _F64, y: _F64) -> tuple[_F64, _F64]:
    """Return the slope dy/dx of the chain about each stroke, and the chain's length."""
    slope, length = np.zeros(len(x)), np.zeros(len(x))
    bounds = np.append(np.flatnonzero(np.diff(chain, prepend=-1)), len(x))
    for first, last in pairwise(bounds):
        piece = slice(int(first), int(last))
        xs, ys = x[piece], y[piece]
        length[piece] = np.ptp(xs) if len(xs) else 0.0
        if len(xs) < 2:
            continue
        near = np.abs(xs[:, None] - xs) <= _DIRECTION_M
        weight = near / near.sum(axis=1, keepdims=True)
        mean_x, mean_y = weight @ xs, weight @ ys
        spread = weight @ (xs * xs) - mean_x**2
        slope[piece] = (weight @ (xs * ys) - mean_x * mean_y) / np.maximum(spread, 1e-9)
    return slope, length


def _spread(points: _F64, view: BirdsEye, config: PaintConfig) -> _F64:
    """Return the spread of strokes across: of the pixels, of the camera's angles, of the ground.

    Ground that is `dz` higher than it is taken for moves a point by its distance over the camera's
    height times `dz`; pitch and roll act like ground that leans.
    """
    cells = np.clip(np.rint(view.grid.cells(points)), 0, np.array(view.grid.shape) - 1)
    rows, columns = cells.astype(np.intp).T
    by_pixel = _PIXEL_SD * view.footprint_m[0][rows, columns].astype(np.float64)
    ahead, beside = np.abs(points - view.eye_m[:2]).T
    height = np.maximum(view.eye_m[2] - view.ground.height(points), 0.3)
    turn = np.radians(config.rotation_sd_deg)
    lean = np.hypot(view.ground.spread(points[:, 0]), turn * np.hypot(ahead, beside))
    terms = (by_pixel, beside / height * lean, turn * ahead, np.full(len(points), _FLOOR_SD_M))
    spread: _F64 = np.sqrt(np.sum(np.square(terms), axis=0))
    return spread
