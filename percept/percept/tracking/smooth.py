"""Tracks with hindsight: what all detections of an object say about each moment of its life.

Positions and velocities go through a fixed-interval smoother (Rauch, Tung, Striebel 1965; in
the form of Bar-Shalom, Li, Kirubarajan, 2001, section 8.6), sizes become one size, yaws follow
the course where the object moves, and classes are smoothed by the same recursion for a hidden
Markov model (Kitagawa 1987, equation 2.4).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.tracking.anchor import completions
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.motion import STATE_SIZE, predict_turns
from percept.tracking.refilter import shifted, walks_of
from percept.tracking.smooth_shapes import size_covariances, smooth_shapes

__all__ = ["predict_steps", "smooth_states", "smooth_track"]

_F64 = NDArray[np.float64]


def smooth_track(
    history: TrackHistory,
    config: TrackerConfig,
    *,
    origins_m: _F64 | None = None,
    still_frame: bool = True,
) -> TrackHistory:
    """Return a track with hindsight.

    Args:
        history: What the tracker knew after each step.
        config: The settings that it ran with.
        origins_m: (K, 2) from where the object was seen at each step. With it, boxes around a
            part of the object are completed to its whole size, and the states are those that
            follow from the completed boxes (`percept.tracking.anchor`).
        still_frame: Whether the frame is known not to move, so that an object that moves in it
            points where it goes.

    Returns:
        The same steps; states, covariances, shapes and classes are those given all detections of
        the track. `observed` and `full` stay as they were.
    """
    states, covariances = smooth_states(history, config)
    smooth = replace(
        history,
        states=states,
        covariances=covariances,
        class_probabilities=_smooth_classes(history, config),
    )
    shapes = smooth_shapes(smooth, still_frame=still_frame)
    if origins_m is not None:
        shifts = completions(history, shapes, origins_m)
        if shifts.any():
            states, covariances = smooth_states(shifted(history, shifts, config), config)
            smooth = replace(smooth, states=states, covariances=covariances)
            shapes = smooth_shapes(smooth, still_frame=still_frame)
    covariances = smooth.covariances.copy()
    covariances[:, :2, :2] += size_covariances(smooth, shapes)
    return replace(smooth, covariances=covariances, shapes=shapes)


def predict_steps(history: TrackHistory, config: TrackerConfig) -> tuple[_F64, _F64, _F64]:
    """Return what each step but the last predicts for the next one, as the tracker did.

    Returns:
        (K - 1, D) means, (K - 1, D, D) covariances and (K - 1, D, D) Jacobians.
    """
    count, size = history.states.shape
    states = np.zeros((count - 1, STATE_SIZE))
    covariances = np.zeros((count - 1, STATE_SIZE, STATE_SIZE))
    states[:, :size] = history.states[:-1]
    covariances[:, :size, :size] = history.covariances[:-1]
    turns = np.full(count - 1, history.motion == "turn")
    walks = walks_of(history.class_probabilities[:-1], turns, config)
    dt_s = np.diff(history.stamps_ns) / 1e9
    means, spreads, jacobians = predict_turns(states, covariances, dt_s, walks)
    return means[:, :size], spreads[:, :size, :size], jacobians[:, :size, :size]


def smooth_states(history: TrackHistory, config: TrackerConfig) -> tuple[_F64, _F64]:
    """Return the states (K, D) and covariances (K, D, D) given all detections of the track.

    The recursion runs on what the future adds to the filtered state,
    ``G (addition_next + filtered_next - predicted_next)`` with the gain
    ``G = P F' P_predicted^-1``, and the same of the covariances.
    """
    from percept.tracking.smooth_kernels import add_backwards, shrink_backwards

    means, spreads, jacobians = predict_steps(history, config)
    solved = np.linalg.solve(spreads, jacobians @ history.covariances[:-1])
    gains: _F64 = np.ascontiguousarray(solved.transpose(0, 2, 1), dtype=np.float64)
    additions = add_backwards(gains, history.states[1:] - means)
    covariances = history.covariances + shrink_backwards(gains, history.covariances[1:] - spreads)
    return history.states + additions, 0.5 * (covariances + covariances.transpose(0, 2, 1))


def _smooth_classes(history: TrackHistory, config: TrackerConfig) -> _F64:
    """Return the class probabilities (K, C) given all that was said about the object."""
    from percept.tracking.smooth_kernels import smooth_beliefs

    stays = np.exp(-config.class_change_per_s * np.diff(history.stamps_ns) / 1e9)
    return smooth_beliefs(np.ascontiguousarray(history.class_probabilities), stays)
