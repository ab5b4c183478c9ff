"""Where an object is when only a part of it is seen, and its whole size is known with hindsight.

A LiDAR sees the near sides of an object, and its far end only from some places. The box around
what is seen is too short then and its centre too near, and while more and more comes into view
the centre wanders: a velocity that is none. With the size that the whole track knows, the box is
completed away from the sensor, from the sides that are seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.smooth import predict_steps, smooth_states
from percept.tracking.smooth_shapes import facing_sizes, smooth_shapes

__all__ = ["anchored"]

_F64 = NDArray[np.float64]

_TOLERANCE = 0.1
_TOLERANCE_M = 0.2
_SURE_BESIDE_M = 1.0


def anchored(
    history: TrackHistory, origins_m: _F64, config: TrackerConfig, *, still_frame: bool
) -> TrackHistory:
    """Return a track as the filter would know it, had it known the size from the beginning.

    Its shapes are those with hindsight. Differences of size within the noise of a detector
    (a fifth of a metre and a tenth of the size) move nothing.

    Args:
        history: A track that begins with a detection, as the tracker knew it.
        origins_m: (K, 2) from where it was seen at each step.
        config: The settings that the tracker ran with.
        still_frame: As for `smooth_track`.
    """
    seen = history.observed
    as_seen = np.where(seen[:, None], history.measured[:, 3:], history.shapes)
    states, covariances = smooth_states(history, config)
    smooth = replace(history, states=states, covariances=covariances, shapes=as_seen)
    shapes = smooth_shapes(smooth, still_frame=still_frame)
    parts = facing_sizes(as_seen[seen], shapes[seen, 3])
    shifts = np.zeros((len(history), 3))
    away = history.measured[seen, :2] - origins_m[seen]
    shifts[seen, :2] = _completions(parts, shapes[seen], away)
    return replace(
        history,
        states=history.states + _effect(history, shifts, config),
        shapes=shapes,
        measured=history.measured + np.pad(shifts, ((0, 0), (0, 4))),
    )


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


def _effect(history: TrackHistory, shifts: _F64, config: TrackerConfig) -> _F64:
    """Return what shifts (K, 3) of the measured centres change in the filtered states (K, D).

    The filter is linear in what it measures: with its gain ``K = P H' R^-1`` the change is
    ``(I - K H) F change_before + K shift``, and ``I - K H = P P_predicted^-1``.
    """
    from percept.tracking.smooth_kernels import push_forwards

    _, spreads, jacobians = predict_steps(history, config)
    kept = np.linalg.solve(spreads, history.covariances[1:]).transpose(0, 2, 1) @ jacobians
    precisions = np.where(history.observed[:, None], 1 / history.variances_m2, 0.0)
    gains = history.covariances[:, :, :3] * precisions[:, None]
    pushed = np.einsum("nij,nj->ni", gains, shifts)
    return push_forwards(kept, pushed)
