"""The tracks of one moment as one structured array: a row for each track, a field for a number.

A step of the tracker makes a new table and never writes into an old one, so that going back in
time is nothing but taking an earlier table up again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from percept.tracking.motion import STATE_SIZE

__all__ = [
    "TrackTable",
    "TrackerState",
    "boxes_of",
    "copied",
    "empty_table",
    "joined",
    "put",
    "taken",
]

TrackTable = NDArray[np.void]


def empty_table(classes: int, rows: int = 0) -> TrackTable:
    """Return a table of zeros.

    `state` and `covariance` are whole ones (`percept.tracking.motion`); `shape` is length, width,
    height in metres and yaw in rad; `facing` counts for the direction of the yaw; `belief` is
    the probability of each class and `kind` the index of the most probable one; `score` is the
    mean confidence of its detections, of which there were `hits`. `measured` is the box of the
    one that went into this step, where `observed` says that there was one, and `variances` those
    of its centre.
    """
    return np.zeros(rows, _fields(classes))


@cache
def _fields(classes: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("id", np.int64),
            ("born_ns", np.int64),
            ("seen_ns", np.int64),
            ("turns", np.bool_),
            ("state", np.float64, STATE_SIZE),
            ("covariance", np.float64, (STATE_SIZE, STATE_SIZE)),
            ("shape", np.float64, 4),
            ("facing", np.float64),
            ("belief", np.float64, classes),
            ("kind", np.int64),
            ("score", np.float64),
            ("hits", np.int64),
            ("full", np.bool_),
            ("observed", np.bool_),
            ("measured", np.float64, 7),
            ("variances", np.float64, 3),
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """All that a tracker knows after a step.

    Attributes:
        stamp_ns: Time of the step.
        tracks: The tracks that are alive, read-only.
        next_id: Id of the next one that is born.
        scan: Whether the step was a scan, in which objects could be seen, and not an image.
    """

    stamp_ns: int
    tracks: TrackTable
    next_id: int
    scan: bool

    def __post_init__(self) -> None:
        self.tracks.setflags(write=False)


def boxes_of(tracks: TrackTable) -> NDArray[np.float64]:
    """Return the (N, 7) boxes of a table: centre, length, width, height, yaw."""
    return np.concatenate([tracks["state"][:, :3], tracks["shape"]], axis=1)


def joined(tracks: TrackTable, others: TrackTable) -> TrackTable:
    """Return the rows of both tables."""
    if not len(others):
        return tracks
    both: TrackTable = np.concatenate([_whole_rows(tracks), _whole_rows(others)])
    return both.view(tracks.dtype)


def copied(tracks: TrackTable) -> TrackTable:
    """Return a copy of a table that may be written to."""
    copy: TrackTable = _whole_rows(tracks).copy()
    return copy.view(tracks.dtype)


def taken(tracks: TrackTable, rows: NDArray[np.intp] | NDArray[np.bool_]) -> TrackTable:
    """Return a copy of some rows of a table."""
    some: TrackTable = _whole_rows(tracks)[rows]
    return some.view(tracks.dtype)


def put(tracks: TrackTable, rows: NDArray[np.intp], others: TrackTable) -> None:
    """Replace some rows of a table, in place."""
    _whole_rows(tracks)[rows] = _whole_rows(others)


def _whole_rows(tracks: TrackTable) -> TrackTable:
    """Return a view in which a row is one piece; NumPy copies a table field by field."""
    return tracks.view((np.void, tracks.dtype.itemsize))
