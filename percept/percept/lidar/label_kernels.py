"""Compiled passes that label points by the ground lines around them.

Himmelsbach et al. 2010, section III C: a point belongs to the ground when it is near the line at
its range. Labels equal those of `linefit` 1.1 on one thread, to the last point.

Looking for each point's line is slow. Most points need no look: the heights that the lines reach
within a bin settle what lies well within, above or below them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled
from percept.lidar.ground_kernels import Lines
from percept.lidar.polar_bins import PolarGrid, bin_at

__all__ = ["Cover", "LabelLimits", "bands_of_bins", "cover_of_bins", "label_points"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]

_SPAN_MARGIN_M = 0.1  # a line also speaks for points this far beyond its two ends
_ROUNDING_M = 1e-9
_BAND_ROUNDING_M = np.float32(2e-3)  # float32 heights: no line gets beyond some kilometres


class LabelLimits(NamedTuple):
    """How near a line a point must be, and where the line may come from; see `GroundConfig`."""

    max_distance: float
    search_angle: float


class Cover(NamedTuple):
    """What the lines of a bin's own segment do in the bin.

    Attributes:
        spanned: (S * B,) bool whether a line speaks for all ranges of the bin.
        low: (S * B,) float32 least height of the lines that touch the bin, or inf, metres.
        high: (S * B,) float32 greatest height of these lines, or -inf.
    """

    spanned: NDArray[np.bool_]
    low: _F32
    high: _F32


@compiled
def cover_of_bins(lines: Lines, grid: PolarGrid) -> Cover:
    """Draw the lines into the bins of their segments."""
    size = grid.segments * grid.bins
    spanned = np.zeros(size, np.bool_)
    low = np.full(size, np.inf, np.float32)
    high = np.full(size, -np.inf, np.float32)
    for s in range(grid.segments):
        own = slice(s * grid.bins, (s + 1) * grid.bins)
        cover = Cover(spanned[own], low[own], high[own])
        for j in range(lines.starts[s], lines.starts[s + 1]):
            _draw_line(lines.rows[j], grid, cover)
    return Cover(spanned, low, high)


@compiled
def _draw_line(line: _F64, grid: PolarGrid, cover: Cover) -> None:
    """Draw one line into the bins of its segment."""
    start = line[0] - _SPAN_MARGIN_M
    end = line[1] + _SPAN_MARGIN_M
    width = (grid.r_max - grid.r_min) / grid.bins
    for b in range(bin_at(start - _ROUNDING_M, grid), bin_at(end + _ROUNDING_M, grid) + 1):
        near = line[2] * (grid.r_min + b * width) + line[3]
        far = near + line[2] * width
        cover.low[b] = min(cover.low[b], np.float32(min(near, far)))
        cover.high[b] = max(cover.high[b], np.float32(max(near, far)))
    for b in range(bin_at(start + _ROUNDING_M, grid) + 1, bin_at(end - _ROUNDING_M, grid)):
        cover.spanned[b] = True


@compiled
def bands_of_bins(cover: Cover, occupied: _I32, grid: PolarGrid, limits: LabelLimits) -> _F32:
    """Decide for each bin which heights are ground, which are not, and which need a closer look.

    A point gets its line from its own segment, or else from the nearest segments to both sides
    that have one at its range. Ground is what each line that a point of the bin may get calls so;
    it is not what none of them does.

    Args:
        cover: From `cover_of_bins`.
        occupied: (P,) the bins that have points.
        grid: S segments by B bins.
        limits: How near a line a point must be, and where the line may come from.

    Returns:
        (S * B + 1, 4) float32: a point below the first or above the last height is not ground,
        one from the second to the third is, at whatever range in the bin it lies. The last row
        is for points outside the grid: it has no ground. Rows of empty bins are not set.
    """
    size = grid.segments * grid.bins
    bands = np.empty((size + 1, 4), np.float32)
    bands[size, :2] = np.inf
    bands[size, 2:] = -np.inf
    reach = np.float32(limits.max_distance)
    segment_step = 2.0 * math.pi / grid.segments
    for k in occupied:
        left = right = k
        low, high, spanned = cover.low[k], cover.high[k], cover.spanned[k]
        away = 1
        while not spanned and away * segment_step < limits.search_angle:
            left = _wrapped(left + grid.bins, size)
            right = _wrapped(right - grid.bins, size)
            low = min(low, cover.low[left], cover.low[right])
            high = max(high, cover.high[left], cover.high[right])
            spanned = cover.spanned[left] | cover.spanned[right]
            away += 1
        bands[k, 0] = low - reach - _BAND_ROUNDING_M
        bands[k, 1] = high - reach + _BAND_ROUNDING_M if spanned else np.float32(np.inf)
        bands[k, 2] = low + reach - _BAND_ROUNDING_M
        bands[k, 3] = high + reach + _BAND_ROUNDING_M
    return bands


@compiled
def _wrapped(k: int, size: int) -> int:
    """Return a bin that is at most one turn off, within 0..size-1."""
    if k < 0:
        return k + size
    return k - size if k >= size else k


@compiled
def label_points(
    columns: _F32,
    place: _I32,
    bands: _F32,
    lines: Lines,
    cover: Cover,
    grid: PolarGrid,
    limits: LabelLimits,
) -> NDArray[np.bool_]:
    """Return (N,) bool: is a point near enough (vertically) to the line at its range?

    Args:
        columns: (3, N) float32 x, y and z, metres.
        place: (N,) bin of each point, S * B outside the grid.
        bands: (S * B + 1, 4) from `bands_of_bins`, which settles nearly all points.
        lines: From `fit_lines`.
        cover: From `cover_of_bins`.
        grid: S segments by B bins.
        limits: How near a line a point must be, and where the line may come from.
    """
    z = columns[2]
    labels = np.empty(len(z), np.bool_)
    unsettled = np.empty(len(z), np.int32)
    count = 0
    # No branch: a processor cannot foresee which point is settled.
    for i in range(len(z)):
        k = place[i]
        ground = (z[i] >= bands[k, 1]) & (z[i] <= bands[k, 2])
        labels[i] = ground
        unsettled[count] = i
        count += (not ground) & (z[i] >= bands[k, 0]) & (z[i] <= bands[k, 3])
    for i in unsettled[:count]:
        x, y = np.float64(columns[0, i]), np.float64(columns[1, i])
        at = (math.sqrt(x * x + y * y), np.float64(z[i]))
        distance = _distance_by_search(lines, cover, place[i], at, grid, limits.search_angle)
        labels[i] = distance < limits.max_distance
    return labels


@compiled
def _distance_by_search(
    lines: Lines,
    cover: Cover,
    k: int,
    at: tuple[float, float],
    grid: PolarGrid,
    search_angle: float,
) -> float:
    """Return the vertical distance to the line of the nearest segment that has one, or inf.

    Args:
        lines: From `fit_lines`.
        cover: From `cover_of_bins`: most segments have no line in this bin.
        k: Bin of the point.
        at: Range and height of the point, metres.
        grid: The bins.
        search_angle: How far to look to both sides, rad.
    """
    left = right = k
    segment_step = 2.0 * math.pi / grid.segments
    distance = _distance(lines, k // grid.bins, at)
    away = 1
    while distance == np.inf and away * segment_step < search_angle:
        left = _wrapped(left + grid.bins, len(cover.low))
        right = _wrapped(right - grid.bins, len(cover.low))
        if cover.low[left] < np.inf:
            distance = _distance(lines, left // grid.bins, at)
        if cover.low[right] < np.inf:
            distance = min(distance, _distance(lines, right // grid.bins, at))
        away += 1
    return distance


@compiled
def _distance(lines: Lines, s: int, at: tuple[float, float]) -> float:
    """Return the vertical distance to the last line of segment s that spans the range, or inf."""
    r, z = at
    rows, starts = lines
    for j in range(starts[s + 1] - 1, starts[s] - 1, -1):
        if rows[j, 0] - _SPAN_MARGIN_M < r < rows[j, 1] + _SPAN_MARGIN_M:
            return float(abs(z - (rows[j, 2] * r + rows[j, 3])))
    return np.inf
