"""Compiled passes that put points into polar bins and find the lowest of each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["PolarGrid", "bin_at", "bins_of_points", "lowest_of_bins"]

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]

_OUTSIDE = -1
_NEAR_EDGE = -2
_EDGE_SHARE = 1e-4  # of a segment or bin; far more than the error, even at 3600 segments


class PolarGrid(NamedTuple):
    """Segments (angle from -pi) by bins (range), metres."""

    segments: int
    bins: int
    r_min: float
    r_max: float


@compiled
def bin_at(r: float, grid: PolarGrid) -> int:
    """Return the radial bin of a range, or the nearest one."""
    width = (grid.r_max - grid.r_min) / grid.bins
    return min(max(int((r - grid.r_min) / width), 0), grid.bins - 1)


@compiled
def bins_of_points(points: _F32, grid: PolarGrid) -> _I32:
    """Return (N,) int32 segment * bins + bin of each point (N, 3), -1 outside r_min..r_max.

    The arc tangent is the slowest part of the segmentation. A polynomial that the compiler can
    vectorise decides for all points but those beside an edge of their bin.
    """
    place = np.empty(len(points), np.int32)
    segment_step = 2.0 * math.pi / grid.segments
    bins_per_m = grid.bins / (grid.r_max - grid.r_min)
    nearest_square = grid.r_min * grid.r_min
    farthest_square = grid.r_max * grid.r_max
    for i in range(len(points)):
        x = np.float64(points[i, 0])
        y = np.float64(points[i, 1])
        square = x * x + y * y
        turn = (_angle(x, y) + math.pi) * (1.0 / segment_step)
        ring = (math.sqrt(square) - grid.r_min) * bins_per_m
        s = np.int32(turn)
        b = np.int32(ring)
        to_edge = min(min(turn - s, 1.0 - (turn - s)), min(ring - b, 1.0 - (ring - b)))
        inside = (square > nearest_square) & (square < farthest_square)
        index = s * np.int32(grid.bins) + b
        place[i] = (index if to_edge > _EDGE_SHARE else _NEAR_EDGE) if inside else _OUTSIDE
    for i in range(len(points)):
        if place[i] == _NEAR_EDGE:
            x = np.float64(points[i, 0])
            y = np.float64(points[i, 1])
            segment = int((math.atan2(y, x) + math.pi) / segment_step) % grid.segments
            place[i] = segment * grid.bins + bin_at(math.sqrt(x * x + y * y), grid)
    return place


@compiled
def _angle(x: float, y: float) -> float:
    """Return atan2(y, x) to 2e-8 rad, without branches (Abramowitz and Stegun 4.4.49)."""
    t = (abs(y) - abs(x)) / (abs(y) + abs(x))
    q = t * t
    p = 0.0028662257 * q - 0.0161657367
    p = p * q + 0.0429096138
    p = p * q - 0.0752896400
    p = p * q + 0.1065626393
    p = p * q - 0.1420889944
    p = p * q + 0.1999355085
    p = p * q - 0.3333314528
    beyond_45_deg = (p * q + 1.0) * t
    return math.copysign(math.pi / 2.0 - math.copysign(math.pi / 4.0 - beyond_45_deg, x), y)


@compiled
def lowest_of_bins(points: _F32, place: _I32, grid: PolarGrid) -> _I32:
    """Return (S * B,) int32 first lowest point of each bin, -1 for an empty one."""
    lowest = np.full(grid.segments * grid.bins, -1, np.int32)
    low_z = np.full(grid.segments * grid.bins, np.inf, np.float32)
    for i in range(len(place)):
        k = place[i]
        if k >= 0 and points[i, 2] < low_z[k]:
            low_z[k] = points[i, 2]
            lowest[k] = i
    return lowest
