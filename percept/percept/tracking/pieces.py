"""Tracks as they wait for the end of the drive: small, and with their two ends at hand.

A drive has tens of thousands of tracks, and their covariances alone would take gigabytes. What
the filter made of the measurements follows from these, so only they are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from percept.tracking.config import TrackerConfig
from percept.tracking.history import TrackHistory
from percept.tracking.refilter import filtered_again, part_of, whole
from percept.tracking.smooth import smooth_states

__all__ = ["BACKWARDS", "Moment", "Piece"]

_F64 = NDArray[np.float64]

BACKWARDS = np.array([1.0, 1, 1, -1, -1, -1])
"""Signs of a state that is seen as in a film that runs backwards."""

_HEAD_STEPS = 30  # what comes later says next to nothing about a beginning
_HALF = ("shapes", "class_probabilities", "scores", "variances_m2")  # as 32-bit numbers


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Moment:
    """One end of a track.

    Attributes:
        stamp_ns: Its time.
        state: (6,) state of the filter, with the turn rate.
        covariance: (6, 6) of the same.
        belief: (C,) probabilities of the classes.
        size_m: (3,) length, width and height.
    """

    stamp_ns: int
    state: _F64
    covariance: _F64
    belief: _F64
    size_m: _F64

    @classmethod
    def of(cls, history: TrackHistory) -> Self:
        """Return the last step of a track."""
        state, covariance = whole(history.states[-1], history.covariances[-1])
        return cls(
            stamp_ns=int(history.stamps_ns[-1]),
            state=state,
            covariance=covariance,
            belief=history.class_probabilities[-1].copy(),
            size_m=history.shapes[-1, :3].copy(),
        )


class Piece:
    """What a tracker knew of one object from its first detection to its last.

    Args:
        history: The track; what follows its last detection is left out.
        config: The settings that the tracker ran with.

    Attributes:
        track_id: Its id.
        motion: Name of its motion model.
        detections: How many detections went into it.
        start: Its first moment with hindsight, as a film that runs backwards shows it; size and
            class are those that it had a little later, when they had settled.
        end: Its last moment.
    """

    __slots__ = ("_columns", "_first", "detections", "end", "motion", "start", "track_id")

    def __init__(self, history: TrackHistory, config: TrackerConfig) -> None:
        rows = np.flatnonzero(history.observed)
        seen = part_of(history, int(rows[0]), int(rows[-1]) + 1)
        self.track_id, self.motion = seen.track_id, seen.motion
        self.detections = len(rows)
        self.start, self.end = _start(seen, config), Moment.of(seen)
        # Copies, so that nothing holds on to the rows of the tracker.
        self._first = seen.states[:1].copy(), seen.covariances[:1].copy()
        kept = ("stamps_ns", "observed", "full", "measured")
        self._columns = {name: getattr(seen, name).copy() for name in kept}
        self._columns |= {name: getattr(seen, name).astype(np.float32) for name in _HALF}

    def history(self, config: TrackerConfig) -> TrackHistory:
        """Return the track; its filter runs again, with the settings of the tracker."""
        columns = {
            name: column.astype(np.float64) if name in _HALF else column
            for name, column in self._columns.items()
        }
        states, covariances = self._first
        bare = TrackHistory(
            track_id=self.track_id,
            motion=self.motion,
            states=states,
            covariances=covariances,
            **columns,
        )
        return filtered_again(bare, config)


def _start(seen: TrackHistory, config: TrackerConfig) -> Moment:
    head = part_of(seen, 0, _HEAD_STEPS)
    states, covariances = smooth_states(head, config)
    signs = BACKWARDS[: states.shape[1]]
    state, covariance = whole(states[0] * signs, covariances[0] * np.outer(signs, signs))
    settled = Moment.of(head)
    return replace(settled, stamp_ns=int(seen.stamps_ns[0]), state=state, covariance=covariance)
