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

# Columns of a row: x, y, z, yaw, velocity. What a track has once is not in its rows.
_PLACE, _YAW, _VELOCITY = slice(0, 3), 3, slice(4, 6)
_COLUMNS = 6
_PLANES = (slice(0, 2), slice(3, 5))  # of a state: position, velocity


class TrackRows:
    """Tracks that are alive between their first and their last step, and interpolated between.

    Each has one label, the class that its steps with a detection together hold for the most
    probable one, with the mean probability that they give it; `unknown` only if none of the
    others has a share of it to speak of.

    Args:
        tracks: The tracks, each used once and not kept.
        scans_ns: (S,) times of the scans, rising. Other steps of the tracks are left out.
        config: Settings of the classes.

    Attributes:
        classes: Names of the classes.
        scans_ns: (S,) times of the scans.
    """

    def __init__(
        self, tracks: Iterable[TrackHistory], scans_ns: NDArray[np.int64], config: TrackerConfig
    ) -> None:
        self.classes = tuple(config.classes)
        self.scans_ns = scans_ns
        parts = [_TrackRows.of(track, scans_ns, self.classes) for track in tracks]
        self._ids = np.array([part.track_id for part in parts], dtype=np.int64)
        self._labels = np.array([part.kind for part in parts], dtype=np.int64)
        self._probabilities = np.array([part.probability for part in parts], dtype=np.float64)
        self._scores = np.array([part.score for part in parts], dtype=np.float64)
        self._sizes_m = np.array([part.size_m for part in parts]).reshape(-1, 3)
        lengths = np.array([len(part.scans) for part in parts], dtype=np.int64)
        self._last_rows = np.cumsum(lengths) - 1
        self._first_rows = self._last_rows - lengths + 1
        scans = np.concatenate([*(part.scans for part in parts), np.zeros(0, np.int64)])
        # One rising key for all rows: the track, then the scan.
        self._keys = np.repeat(np.arange(len(parts)) * len(scans_ns), lengths) + scans
        self._firsts_ns = scans_ns[scans[self._first_rows]]
        self._lasts_ns = scans_ns[scans[self._last_rows]]
        self._values = np.concatenate([*(p.values for p in parts), np.zeros((0, _COLUMNS))])
        self._spreads = np.concatenate([*(p.spreads for p in parts), np.zeros((0, 2), np.float32)])
        self._observed = np.concatenate([*(p.observed for p in parts), np.zeros(0, bool)])

    def at(self, stamp_ns: int, frame_id: str) -> Tracks:
        """Return the tracks at any time; positions on cubic curves that keep the velocities."""
        tracks = np.flatnonzero((self._firsts_ns <= stamp_ns) & (stamp_ns <= self._lasts_ns))
        scan = int(np.searchsorted(self.scans_ns, stamp_ns, side="right")) - 1
        keys = tracks * len(self.scans_ns) + scan
        rows = np.searchsorted(self._keys, keys, side="right") - 1
        exact = self._stamps_ns(rows) == stamp_ns
        values, spreads = self._between(rows, np.where(exact, rows, rows + 1), stamp_ns)
        return Tracks(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            ids=self._ids[tracks],
            boxes_m=np.column_stack([values[:, _PLACE], self._sizes_m[tracks], values[:, _YAW]]),
            velocities_mps=values[:, _VELOCITY],
            labels=tuple(self.classes[kind] for kind in self._labels[tracks]),
            label_probabilities=self._probabilities[tracks],
            states=("full",) * len(tracks),
            position_sd_m=spreads[:, 0],
            velocity_sd_mps=spreads[:, 1],
            observed=self._observed[rows] & exact,
            scores=self._scores[tracks],
        )

    def _stamps_ns(self, rows: _Index) -> _Index:
        stamps_ns: _Index = self.scans_ns[self._keys[rows] % max(len(self.scans_ns), 1)]
        return stamps_ns

    def _between(self, rows: _Index, after: _Index, stamp_ns: int) -> tuple[_F64, _F64]:
        """Return the values (N, 6) and spreads (N, 2) at a time between rows and later ones."""
        start, end = self._values[rows], self._values[after]
        span_s = (self._stamps_ns(after) - self._stamps_ns(rows)) / 1e9
        elapsed_s = (stamp_ns - self._stamps_ns(rows)) / 1e9
        share = (elapsed_s / np.where(span_s > 0, span_s, 1.0))[:, None]
        values: _F64 = start + share * (end - start)
        turned = wrap_angle(end[:, _YAW] - start[:, _YAW])
        values[:, _YAW] = wrap_angle(start[:, _YAW] + share[:, 0] * turned)
        # What the cubic Hermite curve bends away from the straight line between the rows.
        mean_step = end[:, :2] - start[:, :2]
        leave = span_s[:, None] * start[:, _VELOCITY] - mean_step
        arrive = span_s[:, None] * end[:, _VELOCITY] - mean_step
        values[:, :2] += share * (1 - share) * ((1 - share) * leave - share * arrive)
        spreads = (1 - share) * self._spreads[rows] + share * self._spreads[after]
        return values, spreads.astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _TrackRows:
    """The rows of one track: one for each scan, the last step at its time.

    `spreads` (K, 2) are the standard deviations of position and velocity.
    """

    track_id: int
    kind: int
    probability: float
    score: float
    size_m: _F64
    scans: _Index
    values: _F64
    spreads: NDArray[np.float32]
    observed: NDArray[np.bool_]

    @classmethod
    def of(cls, track: TrackHistory, scans_ns: NDArray[np.int64], classes: tuple[str, ...]) -> Self:
        kind, probability = _label(track, classes)
        found = np.minimum(np.searchsorted(scans_ns, track.stamps_ns), len(scans_ns) - 1)
        steps = np.flatnonzero(scans_ns[found] == track.stamps_ns)
        firsts = np.flatnonzero(np.diff(found[steps], prepend=-1))
        last = steps[np.append(firsts[1:], len(steps)) - 1]
        states, covariances = track.states[last], track.covariances[last]
        return cls(
            track.track_id,
            kind,
            probability,
            float(track.scores[-1]),
            track.shapes[-1, :3].copy(),
            found[last],
            np.column_stack([states[:, :3], track.shapes[last, 3], states[:, 3:5]]),
            np.sqrt(np.column_stack([_larger(covariances[:, at, at]) for at in _PLANES])).astype(
                np.float32
            ),
            np.logical_or.reduceat(track.observed[steps], firsts),
        )


def _label(track: TrackHistory, classes: tuple[str, ...]) -> tuple[int, float]:
    """Return the class of a track and how probable its detections make it."""
    shares = track.class_probabilities[track.observed].mean(axis=0)
    known = np.array([name != _UNKNOWN for name in classes])
    best = shares
    if (shares[known] >= _LEAST_SHARE).any():
        best = np.where(known, shares, 0.0)
    kind = int(best.argmax())
    return kind, float(shares[kind])


def _larger(covariances: _F64) -> _F64:
    """Return the larger variance (N,) of covariances (N, 2, 2), in any direction."""
    a, b, c = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    larger: _F64 = (a + c) / 2 + np.hypot((a - c) / 2, b)
    return np.maximum(larger, 0.0)
