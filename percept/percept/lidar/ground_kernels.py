"""Compiled passes that fit ground lines to the prototypes of polar bins.

Himmelsbach et al. 2010, sections III A and B: the lowest point of each polar bin is its
prototype, and lines grow outwards through the prototypes of a segment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled
from percept.lidar.polar_bins import Prototypes

__all__ = ["LineLimits", "Lines", "fit_lines"]

_F64 = NDArray[np.float64]
_I32 = NDArray[np.int32]

_FEWEST_PROTOTYPES = 3  # two points fit any line


class LineLimits(NamedTuple):
    """What a line may be, metres; see `GroundConfig`."""

    sensor_height: float
    min_slope: float
    max_slope: float
    max_fit_error: float
    long_threshold: float
    max_long_height: float
    max_start_height: float


class Lines(NamedTuple):
    """The ground lines of all segments.

    Attributes:
        rows: (L, 4) first and last range, slope, and height at range 0; by segment, nearest first.
        starts: (S + 1,) where each segment's lines begin.
    """

    rows: _F64
    starts: _I32


@compiled
def fit_lines(prototypes: Prototypes, limits: LineLimits) -> Lines:
    """Fit the ground lines of all segments.

    Args:
        prototypes: Of all segments.
        limits: What a line may be.
    """
    _, r, z, begins = prototypes
    rows = np.empty((len(r) // 2 + 1, 4))
    starts = np.zeros(len(begins), np.int32)
    for s in range(len(begins) - 1):
        own = slice(begins[s], begins[s + 1])
        starts[s + 1] = starts[s] + _grow_lines(r[own], z[own], limits, rows[starts[s] :])
    return Lines(rows, starts)


@compiled
def _grow_lines(r: _F64, z: _F64, limits: LineLimits, lines: _F64) -> int:
    """Grow lines through the prototypes of one segment; return how many were found."""
    count = 0
    ground = -limits.sensor_height
    first = 0  # the line in hand holds the prototypes first..k-1, whose r and z sum up to sums
    is_long = False
    line = (0.0, 0.0)
    k = 1
    sums = (r[0], z[0]) if len(r) > 0 else (0.0, 0.0)
    while k < len(r):
        is_long = is_long or r[k] - r[k - 1] > limits.long_threshold
        if k - first == 1:
            near = r[k] - r[k - 1] < limits.long_threshold
            if near and abs(z[k - 1] - ground) < limits.max_start_height:
                sums = (sums[0] + r[k], sums[1] + z[k])
            else:
                first = k
                sums = (r[k], z[k])
            k += 1
            continue
        # A long gap is bridged only by a line that can predict what comes after it.
        step = np.inf if is_long else 0.0
        if is_long and k - first >= _FEWEST_PROTOTYPES:
            step = abs(line[0] * r[k] + line[1] - z[k])
        longer = (sums[0] + r[k], sums[1] + z[k])
        line = _fit(r, z, first, k + 1, longer)
        if step <= limits.max_long_height and _is_ground_line(r, z, first, k, line, limits):
            sums = longer
            k += 1
            continue
        if k - first >= _FEWEST_PROTOTYPES:
            ground = _keep_line(r, z, first, k, sums, lines[count])
            count += 1
        # The prototype that broke the line is tried again: it may start the next one.
        first = k - 1
        sums = (r[first], z[first])
        is_long = False
    if k - first >= _FEWEST_PROTOTYPES:
        _keep_line(r, z, first, k, sums, lines[count])
        count += 1
    return count


@compiled
def _fit(r: _F64, z: _F64, first: int, end: int, sums: tuple[float, float]) -> tuple[float, float]:
    """Return slope and height at range 0 of the least-squares line through first..end-1.

    Only the sums of r and z are kept as the line grows, added in the order in which `linefit` adds
    them anew: sums of squares would round otherwise, and labels would no longer be the same.
    """
    mean_r = sums[0] / (end - first)
    mean_z = sums[1] / (end - first)
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
def _keep_line(
    r: _F64, z: _F64, first: int, end: int, sums: tuple[float, float], line: _F64
) -> float:
    """Write the line through prototypes first..end-1; return its height at its far end."""
    slope, offset = _fit(r, z, first, end, sums)
    line[0] = r[first]
    line[1] = r[end - 1]
    line[2] = slope
    line[3] = offset
    return float(slope * r[end - 1] + offset)
