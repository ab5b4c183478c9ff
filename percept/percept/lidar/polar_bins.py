"""Compiled passes that put points into polar bins and find the lowest of each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["PolarGrid", "Prototypes", "bin_at", "bins_of_points", "lowest_of_bins"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]
_I64 = NDArray[np.int64]

_NEAR_EDGE = -1
# More than twice what float32 gets wrong in an angle, and in a range as a share of r_max.
_ANGLE_ERROR_RAD = 5e-6
_RANGE_ERROR = 2e-6
_EMPTY = np.iinfo(np.int64).max
_PI = np.float32(math.pi)
_HALF = np.float32(0.5)
_ZERO = np.float32(0.0)


class PolarGrid(NamedTuple):
    """Segments (angle from -pi) by bins (range), metres."""

    segments: int
    bins: int
    r_min: float
    r_max: float


class Prototypes(NamedTuple):
    """The lowest point of each occupied bin, by segment, nearest first.

    Attributes:
        bins: (P,) int32 segment * bins + bin.
        r: (P,) float64 horizontal range, metres.
        z: (P,) float64 height, metres.
        starts: (S + 1,) where each segment's prototypes begin.
    """

    bins: _I32
    r: _F64
    z: _F64
    starts: _I32


@compiled
def bin_at(r: float, grid: PolarGrid) -> int:
    """Return the radial bin of a range, or the nearest one."""
    width = (grid.r_max - grid.r_min) / grid.bins
    return min(max(int((r - grid.r_min) / width), 0), grid.bins - 1)


@compiled
def bins_of_points(columns: _F32, grid: PolarGrid) -> _I32:
    """Return (N,) int32 segment * bins + bin of each point, segments * bins outside r_min..r_max.

    float32, which the compiler turns into eight or more points at once, decides for all points
    but those that its error might put into the next bin; these are looked at again.

    Args:
        columns: (3, N) float32 x, y and z, metres.
        grid: The bins.
    """
    x, y = columns[0], columns[1]
    place = np.empty(len(x), np.int32)
    segments_per_rad = np.float32(grid.segments / (2.0 * math.pi))
    bins_per_m = np.float32(grid.bins / (grid.r_max - grid.r_min))
    r_min = np.float32(grid.r_min)
    segment_error = np.float32(_ANGLE_ERROR_RAD) * segments_per_rad
    bin_error = np.float32(_RANGE_ERROR * grid.r_max) * bins_per_m
    farthest = np.float32(grid.bins) + bin_error
    outside = np.int32(grid.segments * grid.bins)
    for i in range(len(x)):
        turn = (_angle(x[i], y[i]) + _PI) * segments_per_rad
        ring = (np.float32(math.sqrt(x[i] * x[i] + y[i] * y[i])) - r_min) * bins_per_m
        s, b = np.int32(turn), np.int32(ring)
        index = s * np.int32(grid.bins) + b
        sure = abs(turn - np.float32(s) - _HALF) < _HALF - segment_error
        sure &= abs(ring - np.float32(b) - _HALF) < _HALF - bin_error
        inside = (ring > -bin_error) & (ring < farthest)
        place[i] = (index if sure else np.int32(_NEAR_EDGE)) if inside else outside
    for i in range(len(x)):
        if place[i] == _NEAR_EDGE:
            place[i] = _bin_of_point(np.float64(x[i]), np.float64(y[i]), grid)
    return place


@compiled
def _bin_of_point(x: float, y: float, grid: PolarGrid) -> int:
    """Return the bin of one point in float64."""
    square = x * x + y * y
    if not grid.r_min * grid.r_min < square < grid.r_max * grid.r_max:
        return grid.segments * grid.bins
    segment_step = 2.0 * math.pi / grid.segments
    segment = int((math.atan2(y, x) + math.pi) / segment_step) % grid.segments
    return segment * grid.bins + bin_at(math.sqrt(square), grid)


@compiled
def _angle(x: np.float32, y: np.float32) -> np.float32:
    """Return atan2(y, x) to 1e-6 rad, without branches (Abramowitz and Stegun 4.4.49)."""
    t = (abs(y) - abs(x)) / (abs(y) + abs(x))
    q = t * t
    p = np.float32(0.0028662257) * q - np.float32(0.0161657367)
    p = p * q + np.float32(0.0429096138)
    p = p * q - np.float32(0.0752896400)
    p = p * q + np.float32(0.1065626393)
    p = p * q - np.float32(0.1420889944)
    p = p * q + np.float32(0.1999355085)
    p = p * q - np.float32(0.3333314528)
    from_x_axis = np.float32(math.pi / 4.0) + (p * q + np.float32(1.0)) * t
    upwards = _PI - from_x_axis if x < _ZERO else from_x_axis
    return -upwards if y < _ZERO else upwards


@compiled
def lowest_of_bins(columns: _F32, place: _I32, grid: PolarGrid) -> Prototypes:
    """Return the first lowest point of each bin that has any.

    Args:
        columns: (3, N) float32 x, y and z, metres.
        place: (N,) from `bins_of_points`.
        grid: The bins.
    """
    lowest = np.full(grid.segments * grid.bins + 1, _EMPTY, np.int64)
    z = columns[2]
    for i in range(len(z)):
        # One number orders by height, then by place in the scan: its minimum needs no branch,
        # and whether a point is the lowest so far is what a processor cannot foresee.
        rank = (np.int64(_ordered(z[i])) << 32) | i
        lowest[place[i]] = min(lowest[place[i]], rank)
    return _gather_prototypes(columns, lowest, grid)


@compiled
def _ordered(value: np.float32) -> np.int32:
    """Return an int32 that orders as the float32 does; -0 equals 0."""
    bits = np.float32(value + _ZERO).view(np.int32)
    return bits ^ ((bits >> 31) & np.int32(0x7FFFFFFF))


@compiled
def _gather_prototypes(columns: _F32, lowest: _I64, grid: PolarGrid) -> Prototypes:
    """Collect the lowest points of the bins that have one."""
    bins = np.empty(len(lowest), np.int32)
    starts = np.zeros(grid.segments + 1, np.int32)
    count = 0
    for s in range(grid.segments):
        for k in range(s * grid.bins, (s + 1) * grid.bins):
            bins[count] = k
            count += lowest[k] != _EMPTY
        starts[s + 1] = count
    r = np.empty(count)
    z = np.empty(count)
    for j in range(count):
        i = lowest[bins[j]] & 0xFFFFFFFF
        x = np.float64(columns[0, i])
        y = np.float64(columns[1, i])
        r[j] = math.sqrt(x * x + y * y)
        z[j] = columns[2, i]
    return Prototypes(bins[:count], r, z, starts)
