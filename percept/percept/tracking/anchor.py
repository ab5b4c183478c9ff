"""Where an object is when only a part of it is seen, and its whole size is known with hindsight.

A LiDAR sees the near sides of an object, and its far end only from some places. The box around
what is seen is too short then and its centre too near, and while more and more comes into view
the centre wanders: a velocity that is none. With the size that the whole track knows, the box is
completed away from the sensor, from the sides that are seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.tracking.history import TrackHistory
from percept.tracking.smooth_shapes import facing_sizes

__all__ = ["completions"]

_F64 = NDArray[np.float64]

_TOLERANCE = 0.1
_TOLERANCE_M = 0.2
_SURE_BESIDE_M = 1.0


def completions(history: TrackHistory, shapes: _F64, origins_m: _F64) -> _F64:
    """Return by how much (K, 3) the whole of an object is beside what was measured of it.

    Differences of size within the noise of a detector (a fifth of a metre and a tenth of the
    size) move nothing; a step without a detection has zeros.

    Args:
        history: A track as the tracker knew it.
        shapes: (K, 4) length, width, height and yaw with hindsight.
        origins_m: (K, 2) from where it was seen at each step.
    """
    seen = np.flatnonzero(history.observed)
    measured = history.measured[seen]
    parts = facing_sizes(measured[:, 3:], shapes[seen, 3])
    shifts = np.zeros((len(history), 3))
    shifts[seen, :2] = _completions(parts, shapes[seen], measured[:, :2] - origins_m[seen])
    return shifts


def _completions(parts: _F64, shapes: _F64, away: _F64) -> _F64:
    """Return by how much (N, 2) the centres of parts of an object are beside its centre.

    Args:
        parts: (N, 3) length, width and height of what is seen.
        shapes: (N, 4) length, width, height and yaw of the whole.
        away: (N, 2) from the sensor to the centre of what is seen.
    """
    size, yaws = shapes[:, :2], shapes[:, 3]
    axes = np.stack([np.cos(yaws), np.sin(yaws), -np.sin(yaws), np.cos(yaws)], 1).reshape(-1, 2, 2)
    along = np.einsum("nij,nj->ni", axes, away)
    missing = size - parts[:, :2] - np.maximum(_TOLERANCE * size, _TOLERANCE_M)
    # Where the sensor is beside an object, either of its ends may be the one that is hidden.
    beyond = (np.abs(along) - parts[:, :2] / 2) / _SURE_BESIDE_M
    shift = np.sign(along) * np.maximum(missing, 0.0) / 2 * np.clip(beyond, 0.0, 1.0)
    moved: _F64 = np.einsum("nij,ni->nj", axes, shift)
    return moved
