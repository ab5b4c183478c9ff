"""3D boxes of a run at any moment: tracks between two of their moments, or what a scan showed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import seconds_from_ns
from percept.core.errors import GeometryError
from percept.core.results import Detections3D, Tracks
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import NO_TRACK, SolidBoxes

__all__ = ["solids_of_scans", "solids_of_tracks", "tracks_between"]

_F64 = NDArray[np.float64]

_LONGEST_STEP_NS = 500_000_000
"""Moments of tracks that are farther apart say nothing of the time between them."""


def tracks_between(before: Tracks | None, after: Tracks | None, stamp_ns: int) -> Tracks | None:
    """Return the tracks at a time between two of their moments.

    Objects of both moments are interpolated; one that is only in the nearer moment is moved on
    with its velocity, and one that is only in the farther one has gone, or has not come yet.

    Args:
        before: The last moment at or before that time; None if there is none.
        after: The first moment after it; None if there is none.
        stamp_ns: The time.

    Returns:
        The tracks; None where both moments are too far away.
    """
    near = [one for one in (before, after) if one is not None and _is_near(one, stamp_ns)]
    if not near:
        return None
    nearest = min(near, key=lambda one: abs(one.stamp_ns - stamp_ns))
    moved = _moved(nearest, stamp_ns)
    if len(near) < 2:
        return moved
    other = near[0] if nearest is near[1] else near[1]
    share = abs(stamp_ns - nearest.stamp_ns) / abs(other.stamp_ns - nearest.stamp_ns)
    _, mine, theirs = np.intersect1d(nearest.ids, other.ids, return_indices=True)
    boxes, velocities = moved.boxes_m.copy(), moved.velocities_mps.copy()
    boxes[mine] = _between(nearest.boxes_m[mine], other.boxes_m[theirs], share)
    velocities[mine] = (1 - share) * nearest.velocities_mps[mine] + share * other.velocities_mps[
        theirs
    ]
    return replace(moved, boxes_m=boxes, velocities_mps=velocities)


def solids_of_tracks(
    tracks: Tracks, T_base_tracks: Transform, *, trial: bool = False
) -> SolidBoxes:
    """Return tracks as 3D boxes in the base frame, numbered from 1.

    The confidence is how probable the class is: that an object is there, a full track has shown.

    Args:
        tracks: The tracks at the wanted time. In the base frame itself, as tracks without poses
            are, their velocities are not those over the ground, and are left out.
        T_base_tracks: Maps their frame into the base frame at that time.
        trial: Whether to take those that are not confirmed too.

    Raises:
        GeometryError: If the transform does not start at the frame of the tracks.
    """
    if T_base_tracks.source != tracks.frame_id:
        raise GeometryError(
            f"tracks in frame '{tracks.frame_id}' cannot go through "
            f"T_{T_base_tracks.target}_{T_base_tracks.source}"
        )
    rows = np.flatnonzero([trial or state == "full" for state in tracks.states])
    placed = Detections3D(
        tracks.stamp_ns, "tracks", tracks.frame_id, tracks.boxes_m, tracks.labels, tracks.scores
    ).transformed(T_base_tracks)
    turn = np.arctan2(T_base_tracks.rotation[1, 0], T_base_tracks.rotation[0, 0])
    cos, sin = np.cos(turn), np.sin(turn)
    velocities = tracks.velocities_mps[rows] @ np.array([[cos, sin], [-sin, cos]])
    if tracks.frame_id == T_base_tracks.target:
        velocities = np.full_like(velocities, np.nan)
    return SolidBoxes(
        ids=np.arange(1, len(rows) + 1, dtype=np.int64),
        boxes_m=placed.boxes_m[rows],
        labels=tuple(tracks.labels[row] for row in rows),
        confidences=np.clip(tracks.label_probabilities[rows], 0.0, 1.0),
        sources=("tracks",) * len(rows),
        track_ids=tracks.ids[rows],
        velocities_mps=velocities,
        points=np.full(len(rows), -1, dtype=np.int64),
    )


def solids_of_scans(
    scans: Sequence[Detections3D], T_base_frames: Sequence[Transform]
) -> SolidBoxes:
    """Return what was found in scans as 3D boxes in the base frame, numbered from 1.

    Nothing is known of their motion, and no box of one is that of another.

    Args:
        scans: The scans of the moment.
        T_base_frames: Maps the frame of each into the base frame.

    Raises:
        GeometryError: If a transform does not start at the frame of its scan.
    """
    placed = [scan.transformed(T) for scan, T in zip(scans, T_base_frames, strict=True)]
    count = sum(len(scan) for scan in placed)
    if not count:
        return SolidBoxes.none()
    return SolidBoxes(
        ids=np.arange(1, count + 1, dtype=np.int64),
        boxes_m=np.concatenate([scan.boxes_m for scan in placed]),
        labels=tuple(label for scan in placed for label in scan.labels),
        confidences=np.clip(np.concatenate([scan.confidences for scan in placed]), 0.0, 1.0),
        sources=("lidar",) * count,
        track_ids=np.full(count, NO_TRACK, dtype=np.int64),
        velocities_mps=np.full((count, 2), np.nan),
        points=np.concatenate([np.where(s.points > 0, s.points, -1) for s in placed]),
    )


def _is_near(tracks: Tracks, stamp_ns: int) -> bool:
    return abs(tracks.stamp_ns - stamp_ns) <= _LONGEST_STEP_NS


def _moved(tracks: Tracks, stamp_ns: int) -> Tracks:
    boxes = tracks.boxes_m.copy()
    boxes[:, :2] += tracks.velocities_mps * seconds_from_ns(stamp_ns - tracks.stamp_ns)
    return replace(tracks, stamp_ns=stamp_ns, boxes_m=boxes)


def _between(boxes_m: _F64, others_m: _F64, share: float) -> _F64:
    """Return boxes (N, 7) on the way to others (N, 7); the yaw takes the shorter arc."""
    mixed: _F64 = (1 - share) * boxes_m + share * others_m
    turn = others_m[:, 6] - boxes_m[:, 6]
    yaw = boxes_m[:, 6] + share * np.arctan2(np.sin(turn), np.cos(turn))
    mixed[:, 6] = np.arctan2(np.sin(yaw), np.cos(yaw))
    return mixed
