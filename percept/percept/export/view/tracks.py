"""Tracks as rerun draws them: boxes with ids, arrows, trails, and how sure their class is."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.results import Tracks
from percept.export.palette import class_colour
from percept.export.view.stream import Turns, ViewStream

__all__ = ["MOMENT_BYTES", "TrackDrawing"]

MOMENT_BYTES = 12_000
"""About what the drawing of a moment takes: of forty tracks with their trails."""

_TRAIL_NS = 5 * NS_PER_S
_TRAIL_STEP_NS = NS_PER_S // 2
_PLOT_STEP_NS = NS_PER_S // 2
_PLOTTED = 20
_KEPT = 200
_LONG_LIVED_NS = NS_PER_S
_NAMELESS_RGB = (105, 110, 115)
_CLEAR, _FAINT, _FAINTEST = 2.0, 1.0, 0.5  # widths of lines


@dataclass(slots=True)
class _Life:
    """What is remembered of a track: where it was lately, and how sure its class was.

    Attributes:
        trail: Time and place of the last few seconds.
        stamps_ns: Times of the class probabilities.
        labels: The most probable class at each of them; empty before the track was full.
        probabilities: Its probability.
        last_ns: When it was there last.
    """

    trail: deque[tuple[int, NDArray[np.float64]]] = field(default_factory=deque)
    stamps_ns: list[int] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    probabilities: list[float] = field(default_factory=list)
    last_ns: int = 0

    @property
    def full_ns(self) -> int:
        """How long it was known as a full track."""
        return self.stamps_ns[-1] - self.stamps_ns[0] if self.stamps_ns else 0


class TrackDrawing:
    """Draws tracks into a view.

    Args:
        stream: The view.
        turns: Which moments are drawn.
    """

    legend = (
        "Tracks: a box with its id, class and the probability of that class; grey and nameless "
        "without a class, and very thin while on trial. An arrow is the way of the next second, a "
        f"trail that of the last five. The plot has the {_PLOTTED} tracks with a class that were "
        "full for longest. Objects of single scans and images are hidden in the 3D view; a click "
        "on their eye shows them."
    )

    def __init__(self, stream: ViewStream, turns: Turns) -> None:
        self._stream = stream
        self._turns = turns
        self._lives: dict[int, _Life] = {}

    def add(self, tracks: Tracks) -> None:
        """Draw the tracks of a moment if it is its turn. Moments come in order of time."""
        for row in range(len(tracks)):
            self._remember(tracks, row)
        if self._turns.take("tracks", MOMENT_BYTES):
            full = np.array([state == "full" for state in tracks.states], dtype=bool)
            known = full & np.array([label != "unknown" for label in tracks.labels], dtype=bool)
            drawn: dict[str, rr.AsComponents] = {
                "full": _boxes(tracks, known, _CLEAR),
                "unknown": _boxes(tracks, full & ~known, _FAINT),
                "trial": _boxes(tracks, ~full, _FAINTEST),
                "velocities": _arrows(tracks, full),
                "trails": self._trails(tracks, known),
            }
            for part, what in drawn.items():
                self._stream.log(self._stream.entity_in(tracks.frame_id, "tracks", part), what)
        if len(self._lives) > _KEPT:
            self._forget(tracks.stamp_ns)

    def finish(self) -> None:
        """Plot the class probabilities of the tracks that were full for longest."""
        if self._turns.stride > 1:
            self._stream.note(f"Of the tracks one moment in {self._turns.stride} is drawn.")
        for track_id in self._longest(_LONG_LIVED_NS):
            life = self._lives[track_id]
            labels = np.array(life.labels)
            for label in sorted(set(life.labels)):
                # Where another class is the most probable, this line has a hole.
                values = np.where(labels == label, life.probabilities, np.nan)
                self._plot(track_id, label, np.array(life.stamps_ns), values)
        self._lives.clear()

    def _plot(
        self, track_id: int, label: str, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        at = rr.new_entity_path(["plots", "tracks", str(track_id), label])
        line = rr.SeriesLines(names=f"{track_id} {label}", colors=class_colour(label))
        self._stream.log(at, line, static=True)
        self._stream.send(at, stamps_ns, rr.Scalars.columns(scalars=values))

    def _remember(self, tracks: Tracks, row: int) -> None:
        life = self._lives.setdefault(int(tracks.ids[row]), _Life())
        now_ns = life.last_ns = tracks.stamp_ns
        if not life.trail or now_ns - life.trail[-1][0] >= _TRAIL_STEP_NS:
            life.trail.append((now_ns, tracks.boxes_m[row, :3].copy()))
        while now_ns - life.trail[0][0] > _TRAIL_NS:
            life.trail.popleft()
        is_due = not life.stamps_ns or now_ns - life.stamps_ns[-1] >= _PLOT_STEP_NS
        if tracks.states[row] == "full" and is_due:
            life.stamps_ns.append(now_ns)
            life.labels.append(tracks.labels[row])
            life.probabilities.append(float(tracks.label_probabilities[row]))

    def _trails(self, tracks: Tracks, shown: NDArray[np.bool_]) -> rr.LineStrips3D:
        rows = np.flatnonzero(shown).tolist()
        strips = [
            np.array([*(at for _, at in self._lives[int(tracks.ids[row])].trail), here])
            for row in rows
            for here in [tracks.boxes_m[row, :3]]
        ]
        colours = [class_colour(tracks.labels[row]) for row in rows]
        return rr.LineStrips3D(strips, colors=colours, radii=rr.Radius.ui_points(1.0))

    def _longest(self, least_ns: int) -> list[int]:
        """Return the ids of the tracks that are plotted, those that were full for longest first."""
        lives = (
            (-life.full_ns, track_id)
            for track_id, life in self._lives.items()
            if life.full_ns >= least_ns and {*life.labels} - {"unknown"}
        )
        return [track_id for _, track_id in sorted(lives)[:_PLOTTED]]

    def _forget(self, now_ns: int) -> None:
        """Drop the tracks that are over and were not full for long, so that memory stays flat."""
        kept = set(self._longest(0))
        self._lives = {
            track_id: life
            for track_id, life in self._lives.items()
            if track_id in kept or now_ns - life.last_ns <= _TRAIL_NS
        }


def _boxes(tracks: Tracks, shown: NDArray[np.bool_], width: float) -> rr.Boxes3D:
    """Return some boxes; of those that are not clear the name is seen on pointing at them."""
    boxes = tracks.boxes_m[shown]
    rows = np.flatnonzero(shown).tolist()
    zero = np.zeros(len(boxes))
    half_yaw = boxes[:, 6] / 2
    texts = [
        f"{tracks.ids[row]} {tracks.labels[row]} {tracks.label_probabilities[row]:.2f}"
        for row in rows
    ]
    clear = width == _CLEAR
    return rr.Boxes3D(
        centers=boxes[:, :3],
        half_sizes=boxes[:, 3:6] / 2,
        quaternions=np.column_stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)]),
        colors=[class_colour(tracks.labels[row]) if clear else _NAMELESS_RGB for row in rows],
        radii=rr.Radius.ui_points(width),
        labels=texts,
        show_labels=clear,
    )


def _arrows(tracks: Tracks, shown: NDArray[np.bool_]) -> rr.Arrows3D:
    """Return where each box will be in a second."""
    velocities = tracks.velocities_mps[shown]
    return rr.Arrows3D(
        origins=tracks.boxes_m[shown, :3],
        vectors=np.column_stack([velocities, np.zeros(len(velocities))]),
        colors=[class_colour(tracks.labels[row]) for row in np.flatnonzero(shown).tolist()],
        radii=rr.Radius.ui_points(1.5),
    )
