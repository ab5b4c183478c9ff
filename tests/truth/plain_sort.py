"""A plain tracker to compare with: SORT (Bewley et al., 2016, ICIP) on centres in space.

Constant velocity, a Kalman filter for each object, Hungarian assignment of centres by distance
within each class, tracks from their third detection on that end after two frames without one.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.frames import frame_slices

__all__ = ["PlainSort", "plain_sort"]

_F64 = NDArray[np.float64]


@dataclass(slots=True)
class _Track:
    name: int
    label: str
    box: _F64
    state: _F64
    covariance: _F64
    hits: int = 1
    age: int = 0
    scores: list[float] = field(default_factory=list)
    box_px: _F64 = field(default_factory=lambda: np.full(4, np.nan))


@dataclass(frozen=True, slots=True)
class PlainSort:
    """Settings: distances in metres, the rest in frames; `coast` of prediction are reported."""

    gates_m: dict[str, float] = field(
        default_factory=lambda: {"Car": 3.0, "Cyclist": 2.0, "Pedestrian": 1.0}
    )
    other_gate_m: float = 2.0
    min_hits: int = 3
    max_age: int = 2
    coast: int = 2
    least_score: float = 0.3


def plain_sort(
    detections: TrackedBoxes, frames: int, settings: PlainSort | None = None
) -> TrackedBoxes:
    """Track the boxes of a sequence; a track goes on for a few frames in which it is not seen."""
    chosen = settings or PlainSort()
    tracks: list[_Track] = []
    rows: list[tuple[int, _Track, _F64, _F64]] = []
    births = 0
    numbers = np.arange(frames)
    for frame, found in zip(numbers, frame_slices(detections.frames, numbers), strict=True):
        used = [int(row) for row in found if detections.scores[row] >= chosen.least_score]
        for track in tracks:
            _predict(track)
        pairs = _assign(tracks, detections, used, chosen)
        for k, row in pairs.items():
            _update(tracks[k], detections, row)
        tracks = [track for track in tracks if track.age <= chosen.max_age]
        for row in sorted(set(used) - set(pairs.values())):
            tracks.append(_born(births, detections, row))
            births += 1
        rows += [
            (int(frame), t, t.box, t.state[3:5])
            for t in tracks
            if t.age <= chosen.coast and t.hits >= chosen.min_hits
        ]
    return TrackedBoxes(
        frames=np.array([row[0] for row in rows], np.int64),
        ids=np.array([row[1].name for row in rows], np.int64),
        labels=tuple(row[1].label for row in rows),
        boxes_px=np.array([row[1].box_px for row in rows]).reshape(-1, 4),
        boxes_m=np.array([row[2] for row in rows]).reshape(-1, 7),
        velocities_mps=np.array([row[3] for row in rows]).reshape(-1, 2),
        scores=np.array([np.mean(row[1].scores) for row in rows]),
    )


_STEP = np.eye(6) + np.eye(6, k=3) * 0.1
_NOISE = np.diag([0.01, 0.01, 0.01, 0.1, 0.1, 0.01])
_SEEN = np.eye(3, 6)
_ERROR = np.eye(3) * 0.1


def _predict(track: _Track) -> None:
    track.state = _STEP @ track.state
    track.covariance = _STEP @ track.covariance @ _STEP.T + _NOISE
    track.age += 1
    track.box = np.concatenate([track.state[:3], track.box[3:]])


def _update(track: _Track, detections: TrackedBoxes, row: int) -> None:
    box = detections.boxes_m[row]
    spread = _SEEN @ track.covariance @ _SEEN.T + _ERROR
    gain = track.covariance @ _SEEN.T @ np.linalg.inv(spread)
    track.state = track.state + gain @ (box[:3] - _SEEN @ track.state)
    track.covariance = (np.eye(6) - gain @ _SEEN) @ track.covariance
    track.box = np.concatenate([track.state[:3], box[3:]])
    track.box_px = detections.boxes_px[row]
    track.hits, track.age = track.hits + 1, 0
    track.scores.append(float(detections.scores[row]))


def _born(name: int, detections: TrackedBoxes, row: int) -> _Track:
    box = detections.boxes_m[row].copy()
    covariance = np.diag([0.1, 0.1, 0.1, 100.0, 100.0, 1.0])
    return _Track(
        name,
        detections.labels[row],
        box,
        np.concatenate([box[:3], np.zeros(3)]),
        covariance,
        scores=[float(detections.scores[row])],
        box_px=detections.boxes_px[row],
    )


def _assign(
    tracks: list[_Track], detections: TrackedBoxes, used: list[int], settings: PlainSort
) -> dict[int, int]:
    places = np.array([track.state[:2] for track in tracks]).reshape(-1, 2)
    offsets = places[:, None] - detections.boxes_m[None, used, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    gates = [settings.gates_m.get(track.label, settings.other_gate_m) for track in tracks]
    same = np.array(
        [[t.label == detections.labels[row] for row in used] for t in tracks], dtype=bool
    )
    allowed = (distance <= np.array(gates)[:, None]) & same.reshape(distance.shape)
    rows, columns = linear_sum_assignment(np.where(allowed, distance, 1e6))
    return {int(k): used[j] for k, j in zip(rows, columns, strict=True) if allowed[k, j]}
