"""The steps of all tracks of a drive in flat columns, and what they say about any moment."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Tracks
from percept.tracking.config import TrackerConfig
from percept.tracking.filter import wrap_angle
from percept.tracking.history import TrackHistory

__all__ = ["TrackRows"]

_F64 = NDArray[np.float64]
_Index = NDArray[np.int64]

_UNKNOWN = "unknown"
_LEAST_SHARE = 0.3

# Columns of a row: box (7), velocity (2), probability of the label, deviations of both.
_BOX, _YAW, _VELOCITY, _PROBABILITY, _POSITION_SD, _VELOCITY_SD = (
    slice(7),
    6,
    slice(7, 9),
    9,
    10,
    11,
)


class TrackRows:
    """Tracks that are alive between their first and their last step, and interpolated between.

    Each has one label, the class that its steps with a detection together hold for the most
    probable one; `unknown` only if none of the others has a share of it to speak of.

    Args:
        tracks: The tracks, each used once and not kept.
        scans_ns: (S,) times of the scans, rising. Other steps of the tracks are left out.
        config: Settings of the classes.

    Attributes:
        classes: Names of the classes.
    """

    def __init__(
        self, tracks: Iterable[TrackHistory], scans_ns: NDArray[np.int64], config: TrackerConfig
    ) -> None:
        self.classes = tuple(config.classes)
        self._scans_ns = scans_ns
        pieces = [_TrackRows.of(track, scans_ns, self.classes) for track in tracks]
        self._ids = np.array([piece.track_id for piece in pieces], dtype=np.int64)
        self._labels = np.array([piece.kind for piece in pieces], dtype=np.int64)
        self._scores = np.array([piece.score for piece in pieces], dtype=np.float64)
        self._stamps_ns = np.concatenate([*(p.stamps_ns for p in pieces), np.zeros(0, np.int64)])
        self._values = np.concatenate([*(p.values for p in pieces), np.zeros((0, 12))])
        self._observed = np.concatenate([*(p.observed for p in pieces), np.zeros(0, bool)])
        lengths = np.array([len(piece.stamps_ns) for piece in pieces], dtype=np.int64)
        self._last_rows = np.cumsum(lengths) - 1
        self._first_rows = self._last_rows - lengths + 1
        # One rising key for all rows: the track, then the scan.
        track_of_row = np.repeat(np.arange(len(pieces)), lengths)
        self._keys = track_of_row * len(scans_ns) + np.searchsorted(scans_ns, self._stamps_ns)

    def at(self, stamp_ns: int, frame_id: str) -> Tracks:
        """Return the tracks at any time; positions on cubic curves that keep the velocities."""
        alive = (self._stamps_ns[self._first_rows] <= stamp_ns) & (
            stamp_ns <= self._stamps_ns[self._last_rows]
        )
        tracks = np.flatnonzero(alive)
        scan = int(np.searchsorted(self._scans_ns, stamp_ns, side="right")) - 1
        keys = tracks * len(self._scans_ns) + scan
        rows = np.searchsorted(self._keys, keys, side="right") - 1
        values = self._between(rows, stamp_ns)
        return Tracks(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            ids=self._ids[tracks],
            boxes_m=values[:, _BOX],
            velocities_mps=values[:, _VELOCITY],
            labels=tuple(self.classes[kind] for kind in self._labels[tracks]),
            label_probabilities=values[:, _PROBABILITY],
            states=("full",) * len(tracks),
            position_sd_m=values[:, _POSITION_SD],
            velocity_sd_mps=values[:, _VELOCITY_SD],
            observed=self._observed[rows] & (self._stamps_ns[rows] == stamp_ns),
            scores=self._scores[tracks],
        )

    def _between(self, rows: _Index, stamp_ns: int) -> _F64:
        """Return the values (N, 12) at a time not before the rows and before the next ones."""
        after = np.where(self._stamps_ns[rows] == stamp_ns, rows, rows + 1)
        start, end = self._values[rows], self._values[after]
        span_s = (self._stamps_ns[after] - self._stamps_ns[rows]) / 1e9
        elapsed_s = (stamp_ns - self._stamps_ns[rows]) / 1e9
        share = (elapsed_s / np.where(span_s > 0, span_s, 1.0))[:, None]
        values: _F64 = start + share * (end - start)
        turned = wrap_angle(end[:, _YAW] - start[:, _YAW])
        values[:, _YAW] = wrap_angle(start[:, _YAW] + share[:, 0] * turned)
        # What the cubic Hermite curve bends away from the straight line between the rows.
        mean_step = end[:, :2] - start[:, :2]
        leave = span_s[:, None] * start[:, _VELOCITY] - mean_step
        arrive = span_s[:, None] * end[:, _VELOCITY] - mean_step
        values[:, :2] += share * (1 - share) * ((1 - share) * leave - share * arrive)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class _TrackRows:
    """The rows of one track: one for each scan, the last step at its time."""

    track_id: int
    kind: int
    score: float
    stamps_ns: _Index
    values: _F64
    observed: NDArray[np.bool_]

    @classmethod
    def of(cls, track: TrackHistory, scans_ns: NDArray[np.int64], classes: tuple[str, ...]) -> Self:
        kind = _label(track, classes)
        found = np.minimum(np.searchsorted(scans_ns, track.stamps_ns), len(scans_ns) - 1)
        steps = np.flatnonzero(scans_ns[found] == track.stamps_ns)
        stamps_ns, firsts = np.unique(track.stamps_ns[steps], return_index=True)
        observed = np.logical_or.reduceat(track.observed[steps], firsts)
        last = steps[np.append(firsts[1:], len(steps)) - 1]
        score = float(track.scores[-1])
        return cls(track.track_id, kind, score, stamps_ns, _values(track, kind)[last], observed)


def _label(track: TrackHistory, classes: tuple[str, ...]) -> int:
    shares = track.class_probabilities[track.observed].mean(axis=0)
    known = np.array([name != _UNKNOWN for name in classes])
    if (shares[known] >= _LEAST_SHARE).any():
        shares[~known] = 0.0
    return int(shares.argmax())


def _values(track: TrackHistory, kind: int) -> _F64:
    planar, velocity = slice(0, 2), slice(3, 5)
    return np.column_stack(
        [
            track.states[:, :3],
            track.shapes,
            track.states[:, velocity],
            track.class_probabilities[:, kind],
            _larger_sd(track.covariances[:, planar, planar]),
            _larger_sd(track.covariances[:, velocity, velocity]),
        ]
    )


def _larger_sd(covariances: _F64) -> _F64:
    """Return the larger standard deviation (N,) of covariances (N, 2, 2), in any direction."""
    largest = np.linalg.eigvalsh(covariances)[:, -1]
    deviations: _F64 = np.sqrt(np.maximum(largest, 0.0))
    return deviations
