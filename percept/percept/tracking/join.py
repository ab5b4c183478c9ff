"""Pieces of one object become one track: gaps are closed from both sides.

An object that was hidden for a while ends as one track and begins again as another. The end of
the one is predicted forwards and the beginning of the other backwards, to the middle of the
gap, where both must agree in position, velocity, class and size.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from percept.core.settings import Settings
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.motion import predict_turns
from percept.tracking.pieces import BACKWARDS, Moment, Piece
from percept.tracking.refilter import continued, walks_of

__all__ = ["Chain", "JoinConfig", "join_tracks", "whole_track"]

Chain = list[Piece]
"""The pieces of one object, in order of time."""

_F64 = NDArray[np.float64]
_Index = NDArray[np.int64]

_PLANE = (0, 1, 3, 4)
_SIZE_SD = 0.3  # of the natural logarithms of what is seen of a size
_THINNEST_M = 0.05  # a flat cluster has no width
# Scans that are no farther apart are of one moment, and what they show are two objects.
_ONE_MOMENT_NS = 1_000_000
_BLOCK = 500


class JoinConfig(Settings):
    """When two tracks are pieces of one object.

    Attributes:
        least_detections: Tracks with fewer detections are not joined: any two lie on a line.
        longest_gap_s: Longest time between the last detection of one and the first of the other.
        gate_sigma: Largest Mahalanobis distance of position and velocity where they meet.
        largest_cost: Largest -2 log likelihood, in metres and m/s, of the differences of position,
            velocity, size and class together: where the prediction has become vague, another
            object is as likely.
    """

    least_detections: int = Field(default=3, ge=2)
    longest_gap_s: float = Field(default=3.0, ge=0)
    gate_sigma: float = Field(default=3.5, gt=0)
    largest_cost: float = 14.0


def join_tracks(pieces: Iterable[Piece], config: TrackerConfig, joining: JoinConfig) -> list[Chain]:
    """Find the tracks that are pieces of one object; never two that exist at one time.

    Which end continues in which beginning is decided for all together (Hungarian), by the
    likelihood of the difference where they meet.

    Args:
        pieces: Tracks as the tracker knew them.
        config: The settings that it ran with.
        joining: When to join.

    Returns:
        The pieces of each object in order of time; the objects by time of birth.
    """
    ordered = sorted(pieces, key=lambda piece: (piece.start.stamp_ns, piece.track_id))
    following = {int(a): int(b) for a, b in _matches(ordered, config, joining)}
    chains = []
    for row in sorted(set(range(len(ordered))) - set(following.values())):
        chain, last = [ordered[row]], row
        while last in following:
            last = following[last]
            chain.append(ordered[last])
        chains.append(chain)
    return chains


def whole_track(chain: Chain, scans_ns: NDArray[np.int64], config: TrackerConfig) -> TrackHistory:
    """Return the pieces of one object as one track, with the id of the first.

    Its gaps have a step at each scan, not observed; after them the filter has run again, on from
    before the gap.

    Args:
        chain: As `join_tracks` returns them.
        scans_ns: (S,) times of all scans, rising.
        config: The settings that the tracker ran with.
    """
    track = chain[0].history(config)
    for piece in chain[1:]:
        track = continued(track, piece.history(config), scans_ns, config)
    return track


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

    @classmethod
    def of(cls, moments: Sequence[Moment], turns: NDArray[np.bool_], config: TrackerConfig) -> Self:
        beliefs = np.stack([moment.belief for moment in moments])
        gates_m = np.array([settings.gate_m for settings in config.classes.values()])
        return cls(
            np.array([moment.stamp_ns for moment in moments]),
            np.stack([moment.state for moment in moments]),
            np.stack([moment.covariance for moment in moments]),
            walks_of(beliefs, turns, config),
            gates_m[beliefs.argmax(axis=1)],
            beliefs,
            np.stack([moment.size_m for moment in moments]),
        )

    @property
    def speeds(self) -> _F64:
        return np.hypot(self.states[:, 3], self.states[:, 4])

    def take(self, rows: _Index) -> _Ends:
        return _Ends(*(getattr(self, name)[rows] for name in self.__slots__))


def _matches(pieces: Sequence[Piece], config: TrackerConfig, joining: JoinConfig) -> _Index:
    """Return (J, 2) which pieces follow which."""
    known = np.flatnonzero([piece.detections >= joining.least_detections for piece in pieces])
    if len(known) < 2:
        return np.empty((0, 2), dtype=np.int64)
    wanted = [pieces[int(row)] for row in known]
    turns = np.array([piece.motion == "turn" for piece in wanted])
    ends = _Ends.of([piece.end for piece in wanted], turns, config)
    starts = _Ends.of([piece.start for piece in wanted], turns, config)
    found = [_meeting(ends, starts, pairs, joining) for pairs in _near(ends, starts, joining)]
    pairs = np.concatenate([pairs for pairs, _ in found])
    return known[_best(pairs, np.concatenate([costs for _, costs in found]))]


def _best(pairs: _Index, costs: _F64) -> _Index:
    """Return as many of the pairs (P, 2) as can be, at the least costs, each side once.

    Pairs that no chain of others connects are decided on their own, so that the tables of the
    Hungarian method stay small however long the drive is.
    """
    before, rows = np.unique(pairs[:, 0], return_inverse=True)
    after, columns = np.unique(pairs[:, 1], return_inverse=True)
    nodes = len(before) + len(after)
    links = coo_array((np.ones(len(rows)), (rows, columns + len(before))), shape=(nodes, nodes))
    groups = connected_components(links, directed=False)[1][rows]
    order = np.argsort(groups, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(groups[order])) + 1) if len(order) else []
    return np.concatenate(
        [np.empty((0, 2), np.int64), *(_assigned(pairs[part], costs[part]) for part in parts)]
    )


def _assigned(pairs: _Index, costs: _F64) -> _Index:
    """Return the pairs (J, 2) of the Hungarian method; other pairs than those given are none."""
    before, rows = np.unique(pairs[:, 0], return_inverse=True)
    after, columns = np.unique(pairs[:, 1], return_inverse=True)
    # So dear that as many as can be are joined.
    apart = costs.max() + 1.0 + len(pairs) * (costs.max() - costs.min())
    table = np.full((len(before), len(after)), apart)
    table[rows, columns] = costs
    rows, columns = linear_sum_assignment(table)
    chosen = table[rows, columns] < apart
    return np.stack([before[rows[chosen]], after[columns[chosen]]], axis=1)


def _near(ends: _Ends, starts: _Ends, joining: JoinConfig) -> Iterator[_Index]:
    """Yield the pairs (P, 2) of which the second begins soon after the first, and within reach.

    With the means that are known nothing gets farther than its speed takes it. The pairs come in
    blocks: those near in time alone are many more than those that are left.
    """
    stamps_ns = ends.stamps_ns
    low = np.searchsorted(starts.stamps_ns, stamps_ns + _ONE_MOMENT_NS, side="right")
    high = np.searchsorted(
        starts.stamps_ns, stamps_ns + round(joining.longest_gap_s * 1e9), side="right"
    )
    high = np.maximum(low, high)
    for block in np.array_split(np.arange(len(stamps_ns)), 1 + len(stamps_ns) // _BLOCK):
        before = np.repeat(block, high[block] - low[block])
        after = np.concatenate([np.arange(low[row], high[row]) for row in block])
        apart = ends.states[before, :2] - starts.states[after, :2]
        half_s = (starts.stamps_ns[after] - stamps_ns[before]) / 2e9
        reach = np.maximum(ends.gates_m[before], starts.gates_m[after])
        reach += half_s * (ends.speeds[before] + starts.speeds[after])
        near = np.hypot(apart[:, 0], apart[:, 1]) <= reach
        yield np.stack([before[near], after[near]], axis=1)


def _meeting(ends: _Ends, starts: _Ends, pairs: _Index, joining: JoinConfig) -> tuple[_Index, _F64]:
    """Return those of the pairs that may be one object, and what it costs to say so."""
    costs = _likeness_costs(ends.take(pairs[:, 0]), starts.take(pairs[:, 1]), joining)
    pairs, costs = pairs[np.isfinite(costs)], costs[np.isfinite(costs)]
    costs += _meeting_costs(ends.take(pairs[:, 0]), starts.take(pairs[:, 1]), joining)
    cheap = costs <= joining.largest_cost
    return pairs[cheap], costs[cheap]


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
    apart = (states - BACKWARDS * others)[:, _PLANE]
    total = spreads + more * np.outer(BACKWARDS, BACKWARDS)
    total = total[:, _PLANE][:, :, _PLANE]
    distance = np.einsum("ni,ni->n", apart, np.linalg.solve(total, apart[:, :, None])[:, :, 0])
    costs: _F64 = distance + np.linalg.slogdet(total).logabsdet
    costs[distance > joining.gate_sigma**2] = np.inf
    gate_m = np.maximum(ends.gates_m, starts.gates_m)
    costs[np.hypot(apart[:, 0], apart[:, 1]) > gate_m] = np.inf
    return costs
