"""Compiled passes that fit ground lines to polar bins and label points by them.

Himmelsbach et al. 2010, sections III A to C: the lowest point of each polar bin is its prototype,
lines grow outwards through the prototypes of a segment, and a point belongs to the ground when it
is near the line at its range. Labels equal those of `linefit` 1.1 on one thread, to the last point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled
from percept.lidar.polar_bins import PolarGrid, bin_at

__all__ = ["LineLimits", "bands_of_bins", "fit_lines", "label_points"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I16 = NDArray[np.int16]
_I32 = NDArray[np.int32]
_Lines = tuple[_F64, _I32]  # (L, 4) first and last range, slope, height at range 0; (S + 1,) starts

_SPAN_MARGIN_M = 0.1  # a line also speaks for points this far beyond its two ends
_FEWEST_PROTOTYPES = 3  # two points fit any line
_ROUNDING_M = 1e-9
_BAND_ROUNDING_M = 1e-4
_NO_LINE = -1
_PARTLY = -2  # a line ends within the bin: each point has to look for itself


class LineLimits(NamedTuple):
    """What a line may be, metres; see `GroundConfig`."""

    sensor_height: float
    min_slope: float
    max_slope: float
    max_fit_error: float
    long_threshold: float
    max_long_height: float
    max_start_height: float


@compiled
def fit_lines(points: _F32, lowest: _I32, grid: PolarGrid, limits: LineLimits) -> _Lines:
    """Fit the ground lines of all segments.

    Args:
        points: (N, 3) float32, metres.
        lowest: (S * B,) prototype of each bin, -1 where there is none.
        grid: S segments by B bins.
        limits: What a line may be.

    Returns:
        lines: (L, 4) first and last range, slope, and height at range 0; by segment, nearest first.
        starts: (S + 1,) where each segment's lines begin.
    """
    lines = np.empty((grid.segments * (grid.bins // 2 + 1), 4))
    starts = np.zeros(grid.segments + 1, np.int32)
    r = np.empty(grid.bins)
    z = np.empty(grid.bins)
    for s in range(grid.segments):
        count = 0
        for b in range(grid.bins):
            i = lowest[s * grid.bins + b]
            if i >= 0:
                x = np.float64(points[i, 0])
                y = np.float64(points[i, 1])
                r[count] = math.sqrt(x * x + y * y)
                z[count] = points[i, 2]
                count += 1
        found = _grow_lines(r[:count], z[:count], limits, lines[starts[s] :])
        starts[s + 1] = starts[s] + found
    return lines, starts


@compiled
def _grow_lines(r: _F64, z: _F64, limits: LineLimits, lines: _F64) -> int:
    """Grow lines through the prototypes of one segment; return how many were found."""
    count = 0
    ground = -limits.sensor_height
    first = 0  # the line in hand holds the prototypes first..k-1
    is_long = False
    line = (0.0, 0.0)
    k = 1
    while k < len(r):
        is_long = is_long or r[k] - r[k - 1] > limits.long_threshold
        if k - first == 1:
            near = r[k] - r[k - 1] < limits.long_threshold
            if not (near and abs(z[k - 1] - ground) < limits.max_start_height):
                first = k
            k += 1
            continue
        # A long gap is bridged only by a line that can predict what comes after it.
        step = np.inf if is_long else 0.0
        if is_long and k - first >= _FEWEST_PROTOTYPES:
            step = abs(line[0] * r[k] + line[1] - z[k])
        line = _fit(r, z, first, k + 1)
        if step <= limits.max_long_height and _is_ground_line(r, z, first, k, line, limits):
            k += 1
            continue
        if k - first >= _FEWEST_PROTOTYPES:
            ground = _keep_line(r, z, first, k, lines[count])
            count += 1
        # The prototype that broke the line is tried again: it may start the next one.
        first = k - 1
        is_long = False
    if k - first >= _FEWEST_PROTOTYPES:
        _keep_line(r, z, first, k, lines[count])
        count += 1
    return count


@compiled
def _fit(r: _F64, z: _F64, first: int, end: int) -> tuple[float, float]:
    """Return slope and height at range 0 of the least-squares line through first..end-1."""
    mean_r = 0.0
    mean_z = 0.0
    for k in range(first, end):
        mean_r += r[k]
        mean_z += z[k]
    mean_r /= end - first
    mean_z /= end - first
    spread = 0.0
    slope = 0.0
    for k in range(first, end):
        spread += (r[k] - mean_r) * (r[k] - mean_r)
        slope += (r[k] - mean_r) * (z[k] - mean_z)
    slope /= spread
    return slope, mean_z - slope * mean_r


@compiled
def _is_ground_line(
    r: _F64, z: _F64, first: int, last: int, line: tuple[float, float], limits: LineLimits
) -> bool:
    """Return whether slope and largest residual are within the limits."""
    slope, offset = line
    if not limits.min_slope <= abs(slope) <= limits.max_slope:
        return False
    for k in range(last, first - 1, -1):
        if abs(slope * r[k] + offset - z[k]) > limits.max_fit_error:
            return False
    return True


@compiled
def _keep_line(r: _F64, z: _F64, first: int, end: int, line: _F64) -> float:
    """Write the line through prototypes first..end-1; return its height at its far end."""
    slope, offset = _fit(r, z, first, end)
    line[0] = r[first]
    line[1] = r[end - 1]
    line[2] = slope
    line[3] = offset
    return float(slope * r[end - 1] + offset)


@compiled
def bands_of_bins(
    found: _Lines, lowest: _I32, grid: PolarGrid, max_distance: float, search_angle: float
) -> _F32:
    """Decide for each bin which heights are ground, which are not, and which need a closer look.

    Where a segment has no line, the nearest segments that have one are asked, on both sides, up
    to `search_angle` rad.

    Returns:
        (S * B + 1, 4) float32: a point below the first or above the last height is not ground,
        one from the second to the third is, at whatever range in the bin it lies. The last row
        is for points outside the grid: it has no ground.
    """
    lines, starts = found
    steps = _steps_to_line(found, grid)
    highest = _highest_line_by_bin(lines[: starts[-1]], grid) + max_distance
    bands = np.full((grid.segments * grid.bins + 1, 4), np.inf, np.float32)
    step = 2.0 * math.pi / grid.segments
    width = (grid.r_max - grid.r_min) / grid.bins
    k = -1
    for s, b in np.ndindex(grid.segments, grid.bins):
        k += 1
        away = steps[s, b]
        if lowest[k] < 0 or (away > 0 and away * step >= search_angle):
            continue
        near = grid.r_min + b * width - _ROUNDING_M
        far = near + width + 2.0 * _ROUNDING_M
        left = _line_over(lines, starts, (s + away) % grid.segments, near, far)
        right = _line_over(lines, starts, (s - away) % grid.segments, near, far)
        if min(left, right) == _PARTLY or max(left, right) == _NO_LINE:
            _set_band(bands[k], -np.inf, np.inf, -np.inf, float(highest[b]))
            continue
        left, right = (left if left >= 0 else right), (right if right >= 0 else left)
        low, high = _heights_over(lines[left], near, far)
        other_low, other_high = _heights_over(lines[right], near, far)
        _set_band(
            bands[k],
            min(low, other_low) - max_distance,
            high - max_distance,
            low + max_distance,
            max(high, other_high) + max_distance,
        )
    return bands


@compiled
def _heights_over(line: _F64, near: float, far: float) -> tuple[float, float]:
    """Return the least and the greatest height of a line between two ranges."""
    at_near = line[2] * near + line[3]
    at_far = line[2] * far + line[3]
    return min(at_near, at_far), max(at_near, at_far)


@compiled
def _set_band(band: _F32, low: float, sure_low: float, sure_high: float, high: float) -> None:
    """Write a band, with room for what float32 rounds away."""
    band[0] = low - _BAND_ROUNDING_M - 1e-6 * abs(low)
    band[1] = sure_low + _BAND_ROUNDING_M + 1e-6 * abs(sure_low)
    band[2] = sure_high - _BAND_ROUNDING_M - 1e-6 * abs(sure_high)
    band[3] = high + _BAND_ROUNDING_M + 1e-6 * abs(high)


@compiled
def _steps_to_line(found: _Lines, grid: PolarGrid) -> _I16:
    """Return (S, B) how many segments away, at least, a line touches this bin."""
    lines, starts = found
    steps = np.full((grid.segments, grid.bins), grid.segments, np.int16)
    for s in range(grid.segments):
        for j in range(starts[s], starts[s + 1]):
            start = bin_at(lines[j, 0] - _SPAN_MARGIN_M - _ROUNDING_M, grid)
            end = bin_at(lines[j, 1] + _SPAN_MARGIN_M + _ROUNDING_M, grid)
            steps[s, start : end + 1] = 0
    for lap in range(2 * grid.segments):  # twice round, each way: the circle has no first segment
        s = lap % grid.segments
        _no_more_than_next(steps[s], steps[s - 1])
        _no_more_than_next(steps[-1 - s], steps[(grid.segments - s) % grid.segments])
    return steps


@compiled
def _no_more_than_next(steps: _I16, neighbour: _I16) -> None:
    for b in range(len(steps)):
        steps[b] = min(steps[b], neighbour[b] + np.int16(1))


@compiled
def _line_over(lines: _F64, starts: _I32, s: int, near: float, far: float) -> int:
    """Return the last line of segment s that touches near..far: -1 is none, -2 covers a part."""
    for j in range(starts[s + 1] - 1, starts[s] - 1, -1):
        start = lines[j, 0] - _SPAN_MARGIN_M
        end = lines[j, 1] + _SPAN_MARGIN_M
        if start < far and end > near:
            return j if start < near and end > far else _PARTLY
    return _NO_LINE


@compiled
def label_points(
    points: _F32,
    place: _I32,
    bands: _F32,
    found: _Lines,
    grid: PolarGrid,
    max_distance: float,
    search_angle: float,
) -> NDArray[np.bool_]:
    """Return (N,) bool: is a point within `max_distance` (vertically) of the line at its range?

    Args:
        points: (N, 3) float32, metres.
        place: (N,) bin of each point, -1 outside the grid.
        bands: (S * B + 1, 4) from `bands_of_bins`, which settles nearly all points.
        found: From `fit_lines`.
        grid: S segments by B bins.
        max_distance: Metres.
        search_angle: As in `bands_of_bins`, rad.
    """
    labels = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        k = place[i]  # -1 is the last row
        z = points[i, 2]
        labels[i] = (z >= bands[k, 1]) & (z <= bands[k, 2])
        if labels[i] | (z < bands[k, 0]) | (z > bands[k, 3]):
            continue
        x = np.float64(points[i, 0])
        y = np.float64(points[i, 1])
        r = math.sqrt(x * x + y * y)
        distance = _distance_by_search(found, k // grid.bins, r, np.float64(z), search_angle)
        labels[i] = distance < max_distance
    return labels


@compiled
def _highest_line_by_bin(lines: _F64, grid: PolarGrid) -> _F64:
    """Return (B,) the height that no line of any segment exceeds in this bin."""
    highest = np.full(grid.bins, -np.inf)
    width = (grid.r_max - grid.r_min) / grid.bins
    for j in range(len(lines)):
        start = bin_at(lines[j, 0] - _SPAN_MARGIN_M - _ROUNDING_M, grid)
        end = bin_at(lines[j, 1] + _SPAN_MARGIN_M + _ROUNDING_M, grid)
        for b in range(start, end + 1):
            near = lines[j, 2] * (grid.r_min + b * width) + lines[j, 3]
            rise = lines[j, 2] * width
            highest[b] = max(highest[b], near, near + rise)
    return highest


@compiled
def _distance_by_search(found: _Lines, s: int, r: float, z: float, search_angle: float) -> float:
    """Return the vertical distance to the line of the nearest segment that has one at r, or inf."""
    segments = len(found[1]) - 1
    step = 2.0 * math.pi / segments
    distance = np.inf
    k = 0
    while distance == np.inf and (k == 0 or k * step < search_angle):
        left = s + k if s + k < segments else s + k - segments
        right = s - k if s >= k else s - k + segments
        distance = min(_distance(found, left, r, z), _distance(found, right, r, z))
        k += 1
    return distance


@compiled
def _distance(found: _Lines, s: int, r: float, z: float) -> float:
    """Return the vertical distance to the last line of segment s that spans r, or inf."""
    lines, starts = found
    for j in range(starts[s + 1] - 1, starts[s] - 1, -1):
        if lines[j, 0] - _SPAN_MARGIN_M < r < lines[j, 1] + _SPAN_MARGIN_M:
            return float(abs(z - (lines[j, 2] * r + lines[j, 3])))
    return np.inf
