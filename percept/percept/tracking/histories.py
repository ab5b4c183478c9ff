"""The states of a tracker, regrouped by track."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from percept.tracking.history import TrackHistory
from percept.tracking.motion import STATE_SIZE
from percept.tracking.track_table import TrackerState, TrackTable

__all__ = ["histories_of"]

_Rows = tuple[TrackTable, NDArray[np.int64]]

_BATCH = 128


def histories_of(states: Iterable[TrackerState]) -> Iterator[TrackHistory]:
    """Yield the history of each track through the scans among some states, when it has ended.

    The states are taken one after the other and not held, and neither are the tracks that ended.
    """
    parts: dict[int, list[_Rows]] = defaultdict(list)
    scans = (state for state in states if state.scan and len(state.tracks))
    while batch := list(islice(scans, _BATCH)):
        for rows, stamps_ns in _by_track(batch):
            parts[int(rows["id"][0])].append((rows, stamps_ns))
        for track_id in sorted(parts.keys() - batch[-1].tracks["id"].tolist()):
            yield _history(parts.pop(track_id))
    for track_id in sorted(parts):
        yield _history(parts.pop(track_id))


def _by_track(states: list[TrackerState]) -> Iterator[_Rows]:
    """Yield the rows of each track in some states, and their times."""
    table = np.concatenate([state.tracks for state in states])
    stamps = np.repeat([s.stamp_ns for s in states], [len(s.tracks) for s in states])
    order = np.argsort(table["id"], kind="stable")
    starts = np.flatnonzero(np.diff(table["id"][order])) + 1
    for rows in np.split(order, starts):
        yield table[rows], stamps[rows]


def _history(parts: list[_Rows]) -> TrackHistory:
    rows = np.concatenate([part for part, _ in parts])
    turns = bool(rows["turns"][0])
    size = STATE_SIZE if turns else STATE_SIZE - 1
    return TrackHistory(
        track_id=int(rows["id"][0]),
        motion="turn" if turns else "velocity",
        stamps_ns=np.concatenate([stamps_ns for _, stamps_ns in parts]),
        states=rows["state"][:, :size].copy(),
        covariances=rows["covariance"][:, :size, :size].copy(),
        observed=rows["observed"].copy(),
        shapes=rows["shape"].copy(),
        class_probabilities=rows["belief"].copy(),
        full=rows["full"].copy(),
        scores=rows["score"].copy(),
        measured=np.where(rows["observed"][:, None], rows["measured"], np.nan),
        variances_m2=np.where(rows["observed"][:, None], rows["variances"], np.nan),
    )
