"""A track that goes on after a gap: the filter runs again over the later piece."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.tracking.class_model import ClassModel
from percept.tracking.config import TrackerConfig
from percept.tracking.filter import update_positions
from percept.tracking.history import TrackHistory
from percept.tracking.motion import STATE_SIZE, predict_turns

__all__ = ["continued", "walks_of", "whole"]

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
    states, covariances = _filtered(track, stamps, (measured[:, :3], variances), beliefs, config)
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


def whole(state: _F64, covariance: _F64) -> tuple[_F64, _F64]:
    """Return a state (D,) and covariance (D, D) with the turn rate, 0 where it has none."""
    missing = STATE_SIZE - len(state)
    return np.pad(state, (0, missing)), np.pad(covariance, (0, missing))


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


def _filtered(
    track: TrackHistory,
    stamps_ns: NDArray[np.int64],
    measurements: tuple[_F64, _F64],
    beliefs: _F64,
    config: TrackerConfig,
) -> tuple[_F64, _F64]:
    """Run the filter on from the end of a track: states (K, D) and covariances (K, D, D).

    A step without a measurement, centre and variances (K, 3), has NaN there.
    """
    centres, variances = measurements
    size = track.states.shape[1]
    state, covariance = (part[None] for part in whole(track.states[-1], track.covariances[-1]))
    states = np.empty((len(stamps_ns), STATE_SIZE))
    covariances = np.empty((len(stamps_ns), STATE_SIZE, STATE_SIZE))
    before = np.concatenate([track.class_probabilities[-1:], beliefs[:-1]])
    walks = walks_of(before, np.full(len(before), size == STATE_SIZE), config)
    dt_s = np.diff(stamps_ns, prepend=track.stamps_ns[-1]) / 1e9
    for step in range(len(stamps_ns)):
        row = slice(step, step + 1)
        state, covariance, _ = predict_turns(state, covariance, dt_s[row], walks[row])
        if np.isfinite(centres[step, 0]):
            state, covariance = update_positions(state, covariance, centres[row], variances[row])
        states[step], covariances[step] = state[0], covariance[0]
    return states[:, :size], covariances[:, :size, :size]
