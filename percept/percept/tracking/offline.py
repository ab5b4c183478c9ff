"""A whole drive at once: tracks that know what came before and what came after.

A tracker in a vehicle has to answer at once; a log can be asked later. What is gained: an object
is there from its first detection on and not from its confirmation, until its last one and not
until it is given up; a time for which it was hidden is bridged; its velocity is right from the
beginning; it has one size and one class.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D, Tracks
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.join import Chain, JoinConfig, join_tracks, whole_track
from percept.tracking.pieces import Piece
from percept.tracking.smooth import smooth_track
from percept.tracking.track_rows import TrackRows
from percept.tracking.tracker import Tracker

__all__ = ["TrackedDrive", "track_drive"]


class TrackedDrive:
    """The tracks of a drive, with hindsight.

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

    def at(self, stamp_ns: int) -> Tracks:
        """Return the tracks at any time, with hindsight.

        Each is there from its first detection to its last one, in the state `full`: that it
        would be confirmed is known. Between scans it is interpolated.
        """
        return self._rows.at(stamp_ns, self.frame_id)

    def frames(self) -> Iterator[Tracks]:
        """Yield the tracks with hindsight at the time of each scan, in order, also if none."""
        for stamp_ns in self._rows.scans_ns:
            yield self.at(int(stamp_ns))


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
        detections: All detections, in any order within the rollback window of the settings: what
            comes later is left out and counted. Each is used once and not kept. Scans without
            detections belong to them.
        config: Settings of the tracker.
        poses: As for `Tracker`.
        cameras: As for `Tracker`.
        joining: When two tracks are pieces of one object.
    """
    tracker = Tracker(config, poses=poses, cameras=cameras or {})
    pieces, scans_ns = _tracked(tracker, detections)
    chains = join_tracks(pieces, tracker.config, joining)
    joined = len(pieces) - len(chains)
    del pieces
    tracks = _smoothed(chains, scans_ns, tracker.config, poses)
    return TrackedDrive(
        TrackRows(tracks, scans_ns, tracker.config),
        frame_id=tracker.frame_id,
        dropped=tracker.dropped,
        joined=joined,
        notes=tracker.notes,
    )


def _tracked(
    tracker: Tracker, detections: Iterable[Detections3D | Detections2D]
) -> tuple[list[Piece], NDArray[np.int64]]:
    """Return all tracks that became full, and the times (S,) of the scans, rising."""
    scans_ns: set[int] = set()
    for one in detections:
        tracker.push(one)
        if isinstance(one, Detections3D):
            scans_ns.add(one.stamp_ns)
    pieces = list(_pieces(tracker, tracker.each_history()))
    return pieces, np.array(sorted(scans_ns), dtype=np.int64)


def _pieces(tracker: Tracker, histories: Iterable[TrackHistory]) -> Iterator[Piece]:
    """Yield the tracks that became full; others are counted."""
    for history in histories:
        if history.full.any():
            yield Piece(history, tracker.config)
        else:
            tracker.dropped["tracks that never became full"] += 1


def _smoothed(
    chains: list[Chain],
    scans_ns: NDArray[np.int64],
    config: TrackerConfig,
    poses: Trajectory | None,
) -> Iterator[TrackHistory]:
    """Yield each track with hindsight; its pieces are not needed any more."""
    origins = _origins(poses, scans_ns)
    chains.reverse()
    while chains:
        track = whole_track(chains.pop(), scans_ns, config)
        there = origins[np.searchsorted(scans_ns, track.stamps_ns)]
        yield smooth_track(track, config, origins_m=there, still_frame=poses is not None)


def _origins(poses: Trajectory | None, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the places (K, 2) from which the scans of some times were made."""
    if poses is None:
        return np.zeros((len(stamps_ns), 2))
    found = [poses.at(int(stamp_ns)) for stamp_ns in stamps_ns]
    return np.array([np.zeros(2) if one is None else one.translation_m[:2] for one in found])
