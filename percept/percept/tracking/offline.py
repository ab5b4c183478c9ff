"""A whole drive at once: tracks that know what came before and what came after.

A tracker in a vehicle has to answer at once; a log can be asked later. What is gained: an object
is there from its first detection on and not from its confirmation, until its last one and not
until it is given up; a time for which it was hidden is bridged; its velocity is right from the
beginning; it has one size and one class.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.tracking.anchor import anchored
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.join import JoinConfig, join_tracks
from percept.tracking.smooth import part_of, smooth_track
from percept.tracking.track_rows import TrackRows
from percept.tracking.tracker import Tracker

__all__ = ["TrackedDrive", "track_drive"]

_MOVING_FRAME = (
    "Nothing tells where the vehicle was: tracks are in the frame of the detections, and where "
    "that one moves, velocities are relative to it."
)


class TrackedDrive:
    """The tracks of a drive, with hindsight and without.

    Attributes:
        frame_id: Frame of the tracks, one that does not move.
        classes: Names of the classes that tracks can have.
        dropped: What could not be used, and tracks that never became full, counted by reason.
        joined: How many gaps were closed.
        notes: What a user should know of the tracking, as sentences.
    """

    def __init__(
        self,
        rows: TrackRows,
        filtered: list[Tracks],
        *,
        frame_id: str,
        dropped: Counter[str],
        joined: int,
        notes: tuple[str, ...],
    ) -> None:
        self.frame_id = frame_id
        self.classes = rows.classes
        self.dropped = dropped
        self.joined = joined
        self.notes = notes
        self._rows = rows
        self._filtered = filtered

    def at(self, stamp_ns: int) -> Tracks:
        """Return the tracks at any time, with hindsight.

        Each is there from its first detection to its last one, in the state `full`: that it
        would be confirmed is known. Between scans it is interpolated.
        """
        return self._rows.at(stamp_ns, self.frame_id)

    def frames(self) -> Iterator[Tracks]:
        """Yield the tracks with hindsight at the time of each scan, in order, also if none."""
        for tracks in self._filtered:
            yield self.at(tracks.stamp_ns)

    def filtered_frames(self) -> Iterator[Tracks]:
        """Yield what was known right after each scan, in order: the answer of the vehicle.

        Tracks on trial are among them, and those that are expected and not seen.
        """
        yield from self._filtered


def track_drive(
    detections: Iterable[Detections3D | Detections2D],
    config: TrackerConfig = TrackerConfig(),  # noqa: B008  settings are frozen
    *,
    poses: Trajectory | None = None,
    cameras: Mapping[str, CameraSensor] | None = None,
    joining: JoinConfig = JoinConfig(),  # noqa: B008
) -> TrackedDrive:
    """Track the objects of a drive with hindsight.

    Args:
        detections: All detections, in any order. Scans without detections belong to them.
        config: Settings of the tracker.
        poses: As for `Tracker`.
        cameras: As for `Tracker`.
        joining: When two tracks are pieces of one object.
    """
    tracker = Tracker(config, poses=poses, cameras=cameras or {})
    ordered = sorted(detections, key=lambda one: (one.stamp_ns, isinstance(one, Detections2D)))
    filtered = list(_run(tracker, ordered))
    frame_id, dropped, histories = tracker.frame_id, tracker.dropped, tracker.histories()
    del tracker  # it holds all states of the drive a second time
    scans_ns = np.array([tracks.stamp_ns for tracks in filtered], dtype=np.int64)
    seen = [_seen_part(history) for history in histories if history.full.any()]
    if len(seen) < len(histories):
        dropped["tracks that never became full"] += len(histories) - len(seen)
    del histories
    whole, joined = join_tracks(seen, scans_ns, config, joining)
    rows = TrackRows(_smoothed(whole, scans_ns, config, poses), scans_ns, config)
    return TrackedDrive(
        rows,
        filtered,
        frame_id=frame_id,
        dropped=dropped,
        joined=joined,
        notes=() if poses is not None else (_MOVING_FRAME,),
    )


def _run(tracker: Tracker, ordered: Sequence[Detections3D | Detections2D]) -> Iterator[Tracks]:
    """Push detections in order of time, and yield the tracks after all of each scan's time."""
    scan_ns: int | None = None
    for one in ordered:
        if scan_ns is not None and one.stamp_ns > scan_ns:
            yield tracker.tracks(scan_ns)
            scan_ns = None
        tracker.push(one)
        if isinstance(one, Detections3D):
            scan_ns = one.stamp_ns
    if scan_ns is not None:
        yield tracker.tracks(scan_ns)


def _seen_part(history: TrackHistory) -> TrackHistory:
    """Return a track from its first detection to its last; what follows was never seen."""
    rows = np.flatnonzero(history.observed)
    return part_of(history, int(rows[0]), int(rows[-1]) + 1)


def _smoothed(
    tracks: Iterable[TrackHistory],
    scans_ns: NDArray[np.int64],
    config: TrackerConfig,
    poses: Trajectory | None,
) -> Iterator[TrackHistory]:
    """Yield each track with hindsight of its size, then of everything."""
    origins = _origins(poses, scans_ns)
    still = poses is not None
    for track in tracks:
        there = origins[np.searchsorted(scans_ns, track.stamps_ns)]
        yield smooth_track(
            anchored(track, there, config, still_frame=still), config, still_frame=still
        )


def _origins(poses: Trajectory | None, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the places (K, 2) from which the scans of some times were made."""
    if poses is None:
        return np.zeros((len(stamps_ns), 2))
    found = [poses.at(int(stamp_ns)) for stamp_ns in stamps_ns]
    return np.array([np.zeros(2) if one is None else one.translation_m[:2] for one in found])
