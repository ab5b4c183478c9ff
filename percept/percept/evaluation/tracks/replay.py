"""A detector's boxes of a sequence as scans for a tracker, and its tracks as boxes again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.core.results import Detections3D, Tracks
from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.frames import frame_slices

__all__ = ["FRAME_PERIOD_NS", "detection_scans", "full_tracks", "tracked_boxes"]

FRAME_PERIOD_NS = 100_000_000
"""KITTI's scans come 10 times a second."""

_SENSOR = "velodyne"
_FRAME_ID = "camera_level"
_SAME_M = 3.0
_SURE_AFTER = 6.0

_F64 = NDArray[np.float64]


def detection_scans(detections: TrackedBoxes, frames: int) -> Iterator[Detections3D]:
    """Yield the boxes of each frame; a frame without any is a scan that saw nothing.

    Scores stay as they are: thresholds of the tracker are in the same unit.

    Args:
        detections: Boxes of one sequence; class names become those of percept, in small letters.
        frames: Number of frames.
    """
    labels = [label.lower() for label in detections.labels]
    numbers = np.arange(frames, dtype=np.int64)
    for frame, rows in zip(numbers, frame_slices(detections.frames, numbers), strict=True):
        yield Detections3D(
            int(frame) * FRAME_PERIOD_NS,
            _SENSOR,
            _FRAME_ID,
            detections.boxes_m[rows],
            tuple(labels[row] for row in rows),
            detections.scores[rows],
        )


def tracked_boxes(
    detections: TrackedBoxes,
    tracks: Iterable[Tracks],
    *,
    coast_frames: int,
    names: Mapping[str, str],
    weak_score: float = 0.0,
) -> TrackedBoxes:
    """Return the full tracks of a sequence with what only the detections know.

    A track gets the box in the image of the detection in it, or of its last one while it is
    predicted. Its score is the mean of those of its detections and of 6 weak ones: what was seen
    twice is less sure than what was seen often, and false tracks are short.

    Args:
        detections: The boxes that were tracked.
        tracks: What the tracker says at each frame, from frame 0 on.
        coast_frames: A track that has not been seen for more frames than this is not reported.
        names: Names of the classes that are reported, by those of the tracker.
        weak_score: Score of the weakest boxes of the detector.
    """
    seen: dict[int, tuple[int, _F64]] = {}
    sums: dict[int, tuple[float, float]] = {}
    rows: list[tuple[int, int, str, _F64, _F64, _F64]] = []
    for frame, moment in enumerate(tracks):
        for name, row in _seen_now(detections, frame, moment):
            seen[name] = frame, detections.boxes_px[row]
            total, count = sums.get(name, (_SURE_AFTER * weak_score, _SURE_AFTER))
            sums[name] = total + float(detections.scores[row]), count + 1.0
        for k, name in enumerate(moment.ids.tolist()):
            if name not in seen or moment.states[k] != "full" or moment.labels[k] not in names:
                continue
            last_frame, box_px = seen[name]
            if frame - last_frame <= coast_frames:
                label, box = names[moment.labels[k]], moment.boxes_m[k]
                rows.append((frame, name, label, box_px, box, moment.velocities_mps[k]))
    return TrackedBoxes(
        frames=np.array([row[0] for row in rows], np.int64),
        ids=np.array([row[1] for row in rows], np.int64),
        labels=tuple(row[2] for row in rows),
        boxes_px=np.array([row[3] for row in rows]).reshape(-1, 4),
        boxes_m=np.array([row[4] for row in rows]).reshape(-1, 7),
        velocities_mps=np.array([row[5] for row in rows]).reshape(-1, 2),
        scores=np.array([sums[row[1]][0] / sums[row[1]][1] for row in rows]),
    )


def full_tracks(moments: Iterable[Tracks]) -> tuple[TrackedBoxes, tuple[str, ...]]:
    """Return the full tracks of a run as boxes, and the frames that they are given in.

    Args:
        moments: The tracks of each moment, in order of time.

    Returns:
        The boxes, with stamps in ns for frames, and the names of the coordinate frames, sorted.
    """
    parts = list(moments)
    whole = TrackedBoxes(
        frames=np.repeat(np.array([p.stamp_ns for p in parts], np.int64), [len(p) for p in parts]),
        ids=np.concatenate([np.zeros(0, np.int64), *(p.ids for p in parts)]),
        labels=tuple(label for p in parts for label in p.labels),
        boxes_m=np.concatenate([np.zeros((0, 7)), *(p.boxes_m for p in parts)]),
        velocities_mps=np.concatenate([np.zeros((0, 2)), *(p.velocities_mps for p in parts)]),
    )
    full = np.array([state == "full" for p in parts for state in p.states], dtype=np.bool_)
    return whole.select(full), tuple(sorted({p.frame_id for p in parts}))


def _seen_now(detections: TrackedBoxes, frame: int, moment: Tracks) -> Iterator[tuple[int, int]]:
    """Yield each track that was observed, with the row of its detection."""
    (found,) = frame_slices(detections.frames, np.array([frame]))
    observed = np.flatnonzero(moment.observed)
    offsets = moment.boxes_m[observed, None, :2] - detections.boxes_m[None, found, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    for k, j in zip(*linear_sum_assignment(np.minimum(distance, _SAME_M)), strict=True):
        if distance[k, j] < _SAME_M:
            yield int(moment.ids[observed[k]]), int(found[j])
