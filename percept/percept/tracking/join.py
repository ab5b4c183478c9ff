"""Pieces of one object become one track: gaps are closed from both sides.

An object that was hidden for a while ends as one track and begins again as another. The end of
the one is predicted forwards and the beginning of the other backwards, to the middle of the
gap, where both must agree in position, velocity, class and size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import linear_sum_assignment

from percept.core.settings import Settings
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.motion import predict_turns
from percept.tracking.refilter import continued, walks_of, whole
from percept.tracking.smooth import part_of, smooth_states

__all__ = ["JoinConfig", "join_tracks"]

_F64 = NDArray[np.float64]
_Index = NDArray[np.int64]

_PLANE = (0, 1, 3, 4)
_BACKWARDS = np.array([1.0, 1, 1, -1, -1, -1])
_SIZE_SD = 0.3  # of the natural logarithms of what is seen of a size
_THINNEST_M = 0.05  # a flat cluster has no width
_HEAD_STEPS = 30  # what comes later says next to nothing about a beginning


class JoinConfig(Settings):
    """When two tracks are pieces of one object.

    Attributes:
        longest_gap_s: Longest time between the last detection of one and the first of the other.
        gate_sigma: Largest Mahalanobis distance of position and velocity where they meet.
        largest_cost: Largest -2 log likelihood, in metres and m/s, of the differences of position,
            velocity, size and class together: where the prediction has become vague, another
            object is as likely.
    """

    longest_gap_s: float = Field(default=3.0, ge=0)
    gate_sigma: float = Field(default=3.5, gt=0)
    largest_cost: float = 14.0


def join_tracks(
    tracks: Sequence[TrackHistory],
    scans_ns: NDArray[np.int64],
    config: TrackerConfig,
    joining: JoinConfig,
) -> tuple[list[TrackHistory], int]:
    """Join the tracks that are pieces of one object; never two that exist at one time.

    Which end continues in which beginning is decided for all together (Hungarian), by the
    likelihood of the difference where they meet. A joined track keeps the first id. Its gap has
    a step at each scan, not observed; after it the filter has run again, on from before the gap.

    Args:
        tracks: Tracks that begin and end with a detection, as the tracker knew them.
        scans_ns: (S,) times of all scans, rising.
        config: The settings that the tracker ran with.
        joining: When to join.

    Returns:
        The tracks that are left, by time of birth, and how many gaps were closed.
    """
    pieces = sorted(tracks, key=lambda track: (int(track.stamps_ns[0]), track.track_id))
    following = {int(a): int(b) for a, b in _matches(pieces, config, joining)}
    joined = []
    for row in sorted(set(range(len(pieces))) - set(following.values())):
        track, last = pieces[row], row
        while last in following:
            last = following[last]
            track = continued(track, pieces[last], scans_ns, config)
        joined.append(track)
    return joined, len(following)


@dataclass(frozen=True, slots=True, eq=False)
class _Ends:
    """The last moments of N tracks, or their first ones seen backwards in time."""

    stamps_ns: NDArray[np.int64]
    states: _F64
    covariances: _F64
    walks: _F64
    gates_m: _F64
    beliefs: _F64
    sizes_m: _F64

    def take(self, rows: _Index) -> _Ends:
        return _Ends(*(getattr(self, name)[rows] for name in self.__slots__))


def _matches(pieces: Sequence[TrackHistory], config: TrackerConfig, joining: JoinConfig) -> _Index:
    """Return (J, 2) which pieces follow which."""
    if len(pieces) < 2:
        return np.empty((0, 2), dtype=np.int64)
    ends = _ends([part_of(piece, len(piece) - 1, len(piece)) for piece in pieces], config)
    starts = _ends([_beginning(piece, config) for piece in pieces], config)
    pairs = _near_in_time(ends.stamps_ns, starts.stamps_ns, joining.longest_gap_s)
    costs = _likeness_costs(ends.take(pairs[:, 0]), starts.take(pairs[:, 1]), joining)
    pairs, costs = pairs[np.isfinite(costs)], costs[np.isfinite(costs)]
    costs += _meeting_costs(ends.take(pairs[:, 0]), starts.take(pairs[:, 1]), joining)
    pairs, costs = pairs[costs <= joining.largest_cost], costs[costs <= joining.largest_cost]
    if not len(pairs):
        return pairs
    before, rows = np.unique(pairs[:, 0], return_inverse=True)
    after, columns = np.unique(pairs[:, 1], return_inverse=True)
    apart = costs.max() + 1.0  # so that as many as can be are joined
    table = np.full((len(before), len(after)), apart)
    table[rows, columns] = costs
    rows, columns = linear_sum_assignment(table)
    chosen = table[rows, columns] < apart
    return np.stack([before[rows[chosen]], after[columns[chosen]]], axis=1)


def _beginning(piece: TrackHistory, config: TrackerConfig) -> TrackHistory:
    """Return the first step of a track with hindsight, as a film that runs backwards shows it.

    Size and class are those that it had a little later, when they had settled.
    """
    head = part_of(piece, 0, _HEAD_STEPS)
    states, covariances = smooth_states(head, config)
    sign = _BACKWARDS[: states.shape[1]]
    return replace(
        part_of(piece, 0, 1),
        states=states[:1] * sign,
        covariances=covariances[:1] * np.outer(sign, sign),
        shapes=head.shapes[-1:],
        class_probabilities=head.class_probabilities[-1:],
    )


def _ends(moments: Sequence[TrackHistory], config: TrackerConfig) -> _Ends:
    """Return N tracks of one step each as one table."""
    wholes = [whole(moment.states[0], moment.covariances[0]) for moment in moments]
    beliefs = np.concatenate([moment.class_probabilities for moment in moments])
    turns = np.array([moment.motion == "turn" for moment in moments])
    gates_m = np.array([settings.gate_m for settings in config.classes.values()])
    return _Ends(
        np.concatenate([moment.stamps_ns for moment in moments]),
        np.stack([state for state, _ in wholes]),
        np.stack([covariance for _, covariance in wholes]),
        walks_of(beliefs, turns, config),
        gates_m[beliefs.argmax(axis=1)],
        beliefs,
        np.concatenate([moment.shapes[:, :3] for moment in moments]),
    )


def _near_in_time(
    ends_ns: NDArray[np.int64], births_ns: NDArray[np.int64], longest_gap_s: float
) -> _Index:
    """Return the pairs (P, 2) of which the second begins soon after the first has ended."""
    low = np.searchsorted(births_ns, ends_ns, side="right")
    high = np.searchsorted(births_ns, ends_ns + round(longest_gap_s * 1e9), side="right")
    before = np.repeat(np.arange(len(ends_ns)), high - low)
    after = [np.arange(first, last) for first, last in zip(low, high, strict=True)]
    return np.stack([before, np.concatenate(after)], axis=1)


def _likeness_costs(ends: _Ends, starts: _Ends, joining: JoinConfig) -> _F64:
    """Return (P,) what class and size say against a pair, as -2 log likelihoods, or inf.

    Which side of an object is its length does not matter.
    """
    overlap = np.sqrt(ends.beliefs * starts.beliefs).sum(axis=1)
    ratios = np.abs(_log_sizes(ends) - _log_sizes(starts))
    costs: _F64 = ((ratios / _SIZE_SD) ** 2).sum(axis=1) - 2 * np.log(overlap)
    costs[costs > joining.largest_cost] = np.inf
    return costs


def _log_sizes(side: _Ends) -> _F64:
    """Return the logarithms (N, 3) of the shorter and longer side and the height."""
    sizes = np.maximum(side.sizes_m, _THINNEST_M)
    logs: _F64 = np.log(np.hstack([np.sort(sizes[:, :2], axis=1), sizes[:, 2:]]))
    return logs


def _meeting_costs(ends: _Ends, starts: _Ends, joining: JoinConfig) -> _F64:
    """Return (P,) -2 log likelihood, but for a constant, of both meeting, or inf if they do not.

    Both go half the gap, so that each half of the unknown motion is counted once.
    """
    half_s = (starts.stamps_ns - ends.stamps_ns) / 2e9
    states, spreads, _ = predict_turns(ends.states, ends.covariances, half_s, ends.walks)
    others, more, _ = predict_turns(starts.states, starts.covariances, half_s, starts.walks)
    apart = (states - _BACKWARDS * others)[:, _PLANE]
    total = spreads + more * np.outer(_BACKWARDS, _BACKWARDS)
    total = total[:, _PLANE][:, :, _PLANE]
    distance = np.einsum("ni,ni->n", apart, np.linalg.solve(total, apart[:, :, None])[:, :, 0])
    costs: _F64 = distance + np.linalg.slogdet(total).logabsdet
    costs[distance > joining.gate_sigma**2] = np.inf
    gate_m = np.maximum(ends.gates_m, starts.gates_m)
    costs[np.hypot(apart[:, 0], apart[:, 1]) > gate_m] = np.inf
    return costs
