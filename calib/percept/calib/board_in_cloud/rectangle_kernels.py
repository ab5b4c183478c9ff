"""Compiled likelihood of a rectangle of known size, given which rays met it and which passed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["FARTHEST_SOFT", "edge_distances", "grid_log_likelihood"]

_F64 = NDArray[np.float64]
_ODD = 0.01  # share of rays that tell nothing: a finger on the rim, a mixed pixel
_LOGISTIC_PER_NORMAL = math.sqrt(3.0) / math.pi  # a logistic of this scale has unit variance

# The log likelihood of a ray over its distance, tabled, since it is asked for millions of times.
_FARTHEST, _PER_UNIT = 12.0, 64.0
FARTHEST_SOFT = _FARTHEST * _LOGISTIC_PER_NORMAL  # farther than so many softnesses all is told
_LOG_MET = np.log(
    _ODD
    + (1 - 2 * _ODD)
    / (1 + np.exp(np.arange(-_FARTHEST * _PER_UNIT, _FARTHEST * _PER_UNIT + 1) / _PER_UNIT))
)


@compiled
def edge_distances(crossings: _F64, pose: _F64, half_x: float, half_y: float) -> _F64:
    """Return (K,) how far crossings (K, 2+) lie outside a rectangle; negative is inside.

    Args:
        crossings: Points in the plane, metres.
        pose: (3,) middle x, y and angle.
        half_x: Half its width.
        half_y: Half its height.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    out = np.empty(len(crossings))
    for k in range(len(crossings)):
        x, y = crossings[k, 0] - pose[0], crossings[k, 1] - pose[1]
        out[k] = max(abs(c * x + s * y) - half_x, abs(c * y - s * x) - half_y)
    return out


@compiled
def grid_log_likelihood(
    crossings: _F64,
    is_hit: NDArray[np.bool_],
    poses: _F64,
    half_x: float,
    half_y: float,
    soft_m: float,
) -> _F64:
    """Return (P,) log likelihood of each pose (P, 3).

    A ray at signed distance d outside the rim meets the plate with probability
    Phi(-d / soft), approximated by the logistic function of equal variance.
    """
    out = np.empty(len(poses))
    scale = 1.0 / (soft_m * _LOGISTIC_PER_NORMAL)
    offset = _FARTHEST * _PER_UNIT + 0.5
    for p in range(len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        total = 0.0
        for k in range(len(crossings)):
            x, y = crossings[k, 0] - poses[p, 0], crossings[k, 1] - poses[p, 1]
            outside = max(abs(c * x + s * y) - half_x, abs(c * y - s * x) - half_y)
            z = outside * scale if is_hit[k] else -outside * scale
            z = min(max(z * _PER_UNIT + offset, 0.5), 2 * offset - 1.0)
            total += _LOG_MET[int(z)]
        out[p] = total
    return out
