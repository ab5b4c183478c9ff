"""Compiled passes of the line-fit ground segmentation.

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

__all__ = ["LineLimits", "PolarGrid", "bin_lowest", "fit_lines", "label_points"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]

_SPAN_MARGIN_M = 0.1  # a line also speaks for points this far beyond its two ends
_FEWEST_PROTOTYPES = 3  # two points fit any line


class PolarGrid(NamedTuple):
    """Segments (angle) by bins (range), metres."""

    segments: int
    bins: int
    r_min: float
    r_max: float


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
def bin_lowest(points: _F32, grid: PolarGrid) -> tuple[_F64, _I32, _F64, _F64]:
    """Find the prototype of each bin.

    Args:
        points: (N, 3) float32, metres.
        grid: S segments by B bins.

    Returns:
        ranges: (N,) horizontal range of each point.
        segment: (N,) segment of each point, -1 outside r_min..r_max.
        low_z: (S, B) height of the lowest point, inf in an empty bin.
        low_r: (S, B) range of that point.
    """
    n = len(points)
    ranges = np.empty(n)
    segment = np.empty(n, np.int32)
    low_z = np.full((grid.segments, grid.bins), np.inf)
    low_r = np.zeros((grid.segments, grid.bins))
    step = 2.0 * math.pi / grid.segments
    for i in range(n):
        x = np.float64(points[i, 0])
        y = np.float64(points[i, 1])
        square = x * x + y * y
        r = math.sqrt(square)
        ranges[i] = r
        segment[i] = -1
        if grid.r_min * grid.r_min < square < grid.r_max * grid.r_max:
            s = int((math.atan2(y, x) + math.pi) / step)
            s = 0 if s == grid.segments else s  # an angle of exactly pi
            segment[i] = s
            b = _bin_at(r, grid)
            if points[i, 2] < low_z[s, b]:
                low_z[s, b] = points[i, 2]
                low_r[s, b] = r
    return ranges, segment, low_z, low_r


@compiled
def _bin_at(r: float, grid: PolarGrid) -> int:
    """Return the bin of a range, or the nearest one."""
    width = (grid.r_max - grid.r_min) / grid.bins
    return min(max(int((r - grid.r_min) / width), 0), grid.bins - 1)


@compiled
def fit_lines(low_z: _F64, low_r: _F64, limits: LineLimits) -> tuple[_F64, _I32]:
    """Fit the ground lines of all segments.

    Args:
        low_z: (S, B) heights of the prototypes, inf where there is none.
        low_r: (S, B) their ranges.
        limits: What a line may be.

    Returns:
        lines: (S, B / 2 + 1, 4) first and last range, slope, and height at range 0.
        count: (S,) how many of them each segment has, nearest first.
    """
    segments, bins = low_z.shape
    lines = np.empty((segments, bins // 2 + 1, 4))
    count = np.zeros(segments, np.int32)
    for s in range(segments):
        filled = low_z[s] < np.inf
        count[s] = _grow_lines(low_r[s][filled], low_z[s][filled], limits, lines[s])
    return lines, count


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
        line = _fit(r[first : k + 1], z[first : k + 1])
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
def _fit(r: _F64, z: _F64) -> tuple[float, float]:
    """Return slope and height at range 0 of the least-squares line."""
    mean_r = 0.0
    mean_z = 0.0
    for k in range(len(r)):
        mean_r += r[k]
        mean_z += z[k]
    mean_r /= len(r)
    mean_z /= len(r)
    spread = 0.0
    slope = 0.0
    for k in range(len(r)):
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
    for k in range(first, last + 1):
        if abs(slope * r[k] + offset - z[k]) > limits.max_fit_error:
            return False
    return True


@compiled
def _keep_line(r: _F64, z: _F64, first: int, end: int, line: _F64) -> float:
    """Write the line through prototypes first..end-1; return its height at its far end."""
    slope, offset = _fit(r[first:end], z[first:end])
    line[0] = r[first]
    line[1] = r[end - 1]
    line[2] = slope
    line[3] = offset
    return float(slope * r[end - 1] + offset)


@compiled
def label_points(
    points: _F32,
    ranges: _F64,
    segment: _I32,
    lines: _F64,
    count: _I32,
    grid: PolarGrid,
    max_distance: float,
    search_angle: float,
) -> NDArray[np.bool_]:
    """Return (N,) bool: is a point within `max_distance` (vertically) of the line at its range?

    Where the point's segment has no line, the nearest segments that have one are asked, on both
    sides, up to `search_angle` rad.
    """
    labels = np.zeros(len(points), np.bool_)
    nearest = _steps_to_line(lines, count, grid)
    step = 2.0 * math.pi / grid.segments
    for i in range(len(points)):
        s = segment[i]
        if s < 0:
            continue
        r = ranges[i]
        z = np.float64(points[i, 2])
        k = nearest[s, _bin_at(r, grid)]
        distance = np.inf
        while distance == np.inf and (k == 0 or k * step < search_angle):
            left = (s + k) % grid.segments
            right = (s - k) % grid.segments
            distance = min(
                _distance(lines[left], count[left], r, z),
                _distance(lines[right], count[right], r, z),
            )
            k += 1
        labels[i] = distance < max_distance
    return labels


@compiled
def _distance(lines: _F64, count: int, r: float, z: float) -> float:
    """Return the vertical distance to the last line that spans this range, inf without one."""
    for j in range(count - 1, -1, -1):
        if lines[j, 0] - _SPAN_MARGIN_M < r < lines[j, 1] + _SPAN_MARGIN_M:
            return float(abs(z - (lines[j, 2] * r + lines[j, 3])))
    return np.inf


@compiled
def _steps_to_line(lines: _F64, count: _I32, grid: PolarGrid) -> _I32:
    """Return (S, B) how many segments away, at least, a line touches this bin."""
    steps = np.full((grid.segments, grid.bins), grid.segments, np.int32)
    for s in range(grid.segments):
        for j in range(count[s]):
            start = _bin_at(lines[s, j, 0] - _SPAN_MARGIN_M, grid)
            end = _bin_at(lines[s, j, 1] + _SPAN_MARGIN_M, grid)
            steps[s, start : end + 1] = 0
    for s in range(2 * grid.segments):  # twice round, each way: the circle has no first segment
        forward = s % grid.segments
        steps[forward] = np.minimum(steps[forward], steps[forward - 1] + 1)
        back = -1 - forward
        steps[back] = np.minimum(steps[back], steps[back + 1] + 1)
    return steps
