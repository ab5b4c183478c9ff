"""A track whose filter runs again: on after a gap, or with other measurements."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from percept.tracking.class_model import ClassModel
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.motion import STATE_SIZE

__all__ = ["continued", "filtered_again", "part_of", "shifted", "walks_of", "whole"]

_F64 = NDArray[np.float64]


def continued(
    track: TrackHistory,
    later: TrackHistory,
    scans_ns: NDArray[np.int64],
    config: TrackerConfig,
) -> TrackHistory:
    """Return a track that goes on as a later one, through the scans between them.

    Args:
        track: The earlier one, up to its last detection.
        later: The later one, from its first detection.
        scans_ns: (S,) times of all scans, rising.
        config: The settings that the tracker ran with.
    """
    low = np.searchsorted(scans_ns, track.stamps_ns[-1], side="right")
    high = np.searchsorted(scans_ns, later.stamps_ns[0], side="left")
    gap = high - low
    stamps = np.concatenate([scans_ns[low:high], later.stamps_ns])
    observed = np.concatenate([np.zeros(gap, bool), later.observed])
    measured = np.concatenate([np.full((gap, 7), np.nan), later.measured])
    variances = np.concatenate([np.full((gap, 3), np.nan), later.variances_m2])
    beliefs = _beliefs(track, later, stamps, config)
    counts = track.observed.sum(), np.cumsum(later.observed)
    scores = (counts[0] * track.scores[-1] + counts[1] * later.scores) / (counts[0] + counts[1])
    states, covariances = _filtered_on(track, stamps, (measured[:, :3], variances), beliefs, config)
    return TrackHistory(
        track_id=track.track_id,
        motion=track.motion,
        stamps_ns=np.concatenate([track.stamps_ns, stamps]),
        states=np.concatenate([track.states, states]),
        covariances=np.concatenate([track.covariances, covariances]),
        observed=np.concatenate([track.observed, observed]),
        shapes=np.concatenate([track.shapes, np.repeat(track.shapes[-1:], gap, 0), later.shapes]),
        class_probabilities=np.concatenate([track.class_probabilities, beliefs]),
        full=np.concatenate([track.full, np.ones(gap, bool), later.full]),
        scores=np.concatenate([track.scores, np.repeat(track.scores[-1:], gap), scores]),
        measured=np.concatenate([track.measured, measured]),
        variances_m2=np.concatenate([track.variances_m2, variances]),
    )


def part_of(history: TrackHistory, start: int, stop: int) -> TrackHistory:
    """Return the steps of a track from `start` up to, not including, `stop`."""
    columns = {field.name: getattr(history, field.name) for field in fields(history)}
    steps = {n: column[start:stop] for n, column in columns.items() if np.ndim(column)}
    return replace(history, **steps)


def whole(state: _F64, covariance: _F64) -> tuple[_F64, _F64]:
    """Return a state (D,) and covariance (D, D) with the turn rate, 0 where it has none."""
    size = len(state)
    full_state, full_covariance = np.zeros(STATE_SIZE), np.zeros((STATE_SIZE, STATE_SIZE))
    full_state[:size], full_covariance[:size, :size] = state, covariance
    return full_state, full_covariance


def walks_of(beliefs: _F64, turns: NDArray[np.bool_], config: TrackerConfig) -> _F64:
    """Return (N, 3) spread of velocity, height and turn rate after one second.

    Args:
        beliefs: (N, C) probabilities of the classes.
        turns: (N,) whether the objects have a turn rate.
        config: Settings of the classes.
    """
    table = np.array(
        [
            (one.velocity_walk_mps, one.height_walk_m, one.turn_walk_radps)
            for one in config.classes.values()
        ]
    )
    walks: _F64 = table[beliefs.argmax(axis=1)]
    walks[:, 2] *= turns
    return walks


def _beliefs(
    track: TrackHistory, later: TrackHistory, stamps_ns: NDArray[np.int64], config: TrackerConfig
) -> _F64:
    """Return the class probabilities (K, C) after each step, given both pieces up to then."""
    model = ClassModel(config)
    ages_s = (stamps_ns - track.stamps_ns[-1]) / 1e9
    beliefs = np.stack([model.faded(track.class_probabilities[-1], age) for age in ages_s])
    own = slice(len(stamps_ns) - len(later), None)
    beliefs[own] = model.updated(beliefs[own], later.class_probabilities)
    return beliefs


def filtered_again(track: TrackHistory, config: TrackerConfig) -> TrackHistory:
    """Return a track whose filter has run again over its measurements, from its first state on.

    Args:
        track: The track; of its states and covariances only the first one counts.
        config: The settings that the tracker ran with.
    """
    first = part_of(track, 0, 1)
    states, covariances = _filtered_on(
        first,
        track.stamps_ns[1:],
        (track.measured[1:, :3], track.variances_m2[1:]),
        track.class_probabilities[1:],
        config,
    )
    return replace(
        track,
        states=np.concatenate([first.states, states]),
        covariances=np.concatenate([first.covariances, covariances]),
    )


def shifted(history: TrackHistory, shifts: _F64, config: TrackerConfig) -> TrackHistory:
    """Return a track as the filter would know it, had it measured other centres.

    Args:
        history: A track that begins with a detection, as the tracker knew it.
        shifts: (K, 3) what is added to the measured centres.
        config: The settings that it ran with.
    """
    measured, states = history.measured.copy(), history.states.copy()
    measured[:, :3] += shifts
    states[0, :3] += shifts[0]
    return filtered_again(replace(history, states=states, measured=measured), config)


def _filtered_on(
    track: TrackHistory,
    stamps_ns: NDArray[np.int64],
    measurements: tuple[_F64, _F64],
    beliefs: _F64,
    config: TrackerConfig,
) -> tuple[_F64, _F64]:
    """Run the filter on from the end of a track.

    Args:
        track: The track; only its last step counts.
        stamps_ns: (K,) times of the steps that follow.
        measurements: Their measured centres and the variances of these, (K, 3) each; NaN where
            there was no detection.
        beliefs: (K, C) class probabilities after each step.
        config: The settings that the tracker ran with.

    Returns:
        States (K, D) and covariances (K, D, D).
    """
    from percept.tracking.smooth_kernels import filter_steps

    size = track.states.shape[1]
    state, covariance = whole(track.states[-1], track.covariances[-1])
    before = np.concatenate([track.class_probabilities[-1:], beliefs[:-1]])
    walks = walks_of(before, np.full(len(before), size == STATE_SIZE), config)
    dt_s = np.diff(stamps_ns, prepend=track.stamps_ns[-1]) / 1e9
    centres, variances = (np.ascontiguousarray(part, np.float64) for part in measurements)
    states, covariances = filter_steps(
        state[None], covariance[None], dt_s, walks[: len(dt_s)], centres, variances
    )
    return states[:, :size], covariances[:, :size, :size]
