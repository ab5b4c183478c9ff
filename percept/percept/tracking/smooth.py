"""Tracks with hindsight: what all detections of an object say about each moment of its life.

Positions and velocities go through a fixed-interval smoother (Rauch, Tung, Striebel 1965; in
the form of Bar-Shalom, Li, Kirubarajan, 2001, section 8.6), sizes become one size, yaws follow
the course where the object moves, and classes are smoothed by the same recursion for a hidden
Markov model (Kitagawa 1987, equation 2.4).
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.motion import motion_model
from percept.tracking.smooth_shapes import smooth_shapes

__all__ = ["part_of", "predict_steps", "smooth_states", "smooth_track"]

_F64 = NDArray[np.float64]


def smooth_track(
    history: TrackHistory, config: TrackerConfig, *, still_frame: bool = True
) -> TrackHistory:
    """Return a track with hindsight.

    Args:
        history: What the tracker knew after each step.
        config: The settings that it ran with.
        still_frame: Whether the frame is known not to move, so that an object that moves in it
            points where it goes.

    Returns:
        The same steps; states, covariances, shapes and classes are those given all detections of
        the track. `observed` and `full` stay as they were.
    """
    states, covariances = smooth_states(history, config)
    smooth = replace(history, states=states, covariances=covariances)
    return replace(
        smooth,
        shapes=smooth_shapes(smooth, still_frame=still_frame),
        class_probabilities=_smooth_classes(history, config),
    )


def part_of(history: TrackHistory, start: int, stop: int) -> TrackHistory:
    """Return the steps of a track from `start` up to, not including, `stop`."""
    columns = {field.name: getattr(history, field.name) for field in fields(history)}
    steps = {n: column[start:stop] for n, column in columns.items() if np.ndim(column)}
    return replace(history, **steps)


def predict_steps(history: TrackHistory, config: TrackerConfig) -> tuple[_F64, _F64, _F64]:
    """Return what each step but the last predicts for the next one, as the tracker did.

    Returns:
        (K - 1, D) means, (K - 1, D, D) covariances and (K - 1, D, D) Jacobians.
    """
    dt_s = np.diff(history.stamps_ns) / 1e9
    classes = history.class_probabilities[:-1].argmax(axis=1)
    means = np.empty_like(history.states[1:])
    covariances = np.empty_like(history.covariances[1:])
    jacobians = np.empty_like(covariances)
    settings = list(config.classes.values())
    for number in np.unique(classes):
        rows = np.flatnonzero(classes == number)
        model = motion_model(history.motion, settings[number])
        means[rows], covariances[rows], jacobians[rows] = model.predict(
            history.states[rows], history.covariances[rows], dt_s[rows]
        )
    return means, covariances, jacobians


def smooth_states(history: TrackHistory, config: TrackerConfig) -> tuple[_F64, _F64]:
    """Return the states (K, D) and covariances (K, D, D) given all detections of the track.

    The recursion runs on what the future adds to the filtered state,
    ``G (addition_next + filtered_next - predicted_next)`` with the gain
    ``G = P F' P_predicted^-1``, and the same of the covariances.
    """
    from percept.tracking.smooth_kernels import smooth_backwards

    means, spreads, jacobians = predict_steps(history, config)
    solved = np.linalg.solve(spreads, jacobians @ history.covariances[:-1])
    gains: _F64 = np.ascontiguousarray(solved.transpose(0, 2, 1), dtype=np.float64)
    news = history.states[1:] - means
    shrinkage = history.covariances[1:] - spreads
    additions, shrunk = smooth_backwards(gains, news, shrinkage)
    covariances = history.covariances + shrunk
    return history.states + additions, 0.5 * (covariances + covariances.transpose(0, 2, 1))


def _smooth_classes(history: TrackHistory, config: TrackerConfig) -> _F64:
    """Return the class probabilities (K, C) given all that was said about the object."""
    from percept.tracking.smooth_kernels import smooth_beliefs

    stays = np.exp(-config.class_change_per_s * np.diff(history.stamps_ns) / 1e9)
    return smooth_beliefs(np.ascontiguousarray(history.class_probabilities), stays)
