"""What a run tracked, gathered moment by moment: a few numbers for each track."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.results import Tracks
from percept.export.running import EvenSample

__all__ = ["TrackLife", "TrackMoment", "TrackingSummary"]

_CHART_POINTS = 400
_TRAIL_POINTS = 60


@dataclass(slots=True)
class TrackLife:
    """One track, from its first to its last moment.

    Attributes:
        first_ns: Time of the first moment.
        last_ns: Time of the last one.
        moments: Moments in which it was.
        observed: Moments in which a detection was in it.
        full: Moments in which it was full.
        labels: Full moments by the class that was the most probable.
        speeds_mps: Sum of the speeds of the full moments.
        top_mps: The largest of them.
        trail_m: Places (2,) of full moments, evenly thinned.
    """

    first_ns: int
    last_ns: int = 0
    moments: int = 0
    observed: int = 0
    full: int = 0
    labels: Counter[str] = field(default_factory=Counter)
    speeds_mps: float = 0.0
    top_mps: float = 0.0
    trail_m: EvenSample[NDArray[np.float64]] = field(
        default_factory=lambda: EvenSample(_TRAIL_POINTS)
    )

    @property
    def label(self) -> str:
        """The class that it had for longest as a full track."""
        return self.labels.most_common(1)[0][0]

    @property
    def life_s(self) -> float:
        """Seconds from its first to its last moment."""
        return (self.last_ns - self.first_ns) / NS_PER_S

    @property
    def mean_mps(self) -> float:
        """Its mean speed as a full track."""
        return self.speeds_mps / max(self.full, 1)


@dataclass(frozen=True, slots=True)
class TrackMoment:
    """One moment in the chart over time.

    Attributes:
        stamp_ns: The moment.
        full: Number of full tracks.
        trial: Number of tracks on trial.
    """

    stamp_ns: int
    full: int
    trial: int


class TrackingSummary:
    """Gathers the tracks of a run for its report.

    Attributes:
        moments: Moments that were added.
        frame_id: Frame of the tracks; empty without any.
        first_ns: Time of the first moment, or None.
        last_ns: Time of the last one, or None.
        lives: All tracks by id.
    """

    def __init__(self) -> None:
        self.moments = 0
        self.frame_id = ""
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.lives: dict[int, TrackLife] = {}
        self._timeline: EvenSample[TrackMoment] = EvenSample(_CHART_POINTS)

    def add(self, tracks: Tracks) -> None:
        """Add a moment; moments come in order of time."""
        self.moments += 1
        self.frame_id = tracks.frame_id or self.frame_id
        self.first_ns = tracks.stamp_ns if self.first_ns is None else self.first_ns
        self.last_ns = tracks.stamp_ns
        full = tracks.states.count("full")
        self._timeline.offer(lambda: TrackMoment(tracks.stamp_ns, full, len(tracks) - full))
        speeds = np.hypot(*tracks.velocities_mps.T)
        for row, track_id in enumerate(tracks.ids.tolist()):
            life = self.lives.setdefault(track_id, TrackLife(tracks.stamp_ns))
            life.last_ns = tracks.stamp_ns
            life.moments += 1
            life.observed += bool(tracks.observed[row])
            if tracks.states[row] == "full":
                life.full += 1
                life.labels[tracks.labels[row]] += 1
                life.speeds_mps += float(speeds[row])
                life.top_mps = max(life.top_mps, float(speeds[row]))
                life.trail_m.offer(tracks.boxes_m[row, :2].copy)

    @property
    def timeline(self) -> list[TrackMoment]:
        """Moments for the chart over time, evenly thinned."""
        return self._timeline.chosen()

    def full(self) -> Iterator[TrackLife]:
        """Yield the tracks that became full."""
        return (life for life in self.lives.values() if life.full)

    @property
    def never_full(self) -> int:
        """Number of tracks that were on trial alone."""
        return sum(not life.full for life in self.lives.values())
