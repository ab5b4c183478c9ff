"""CLEAR-MOT (Bernardin and Stiefelhagen, 2008, EURASIP JIVP), as MOTChallenge counts it.

A pair of the past is kept while it is alike enough; the rest is assigned anew. A switch is an
object whose track is another one than its last, whatever lies between.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.tracks.frames import TrackFrame, assign_rows, number_ids

__all__ = ["MOSTLY", "ClearScores", "FrameMatches", "clear_scores", "match_over_time"]

MOSTLY = (0.2, 0.8)
"""Shares of its frames below which an object is mostly lost, and from which mostly tracked."""

_Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
FrameMatches = list[_Pairs]
"""For each frame the rows of the truth and of the tracks that are pairs."""


@dataclass(frozen=True, slots=True)
class ClearScores:
    """Counts that add up over sequences, and the shares that follow from them.

    Attributes:
        frames: Number of frames.
        objects: Boxes of the truth, over all frames.
        tracked: Boxes of tracks.
        matches: Pairs of the two.
        switches: Pairs in which the object's last track was another one.
        fragmentations: How often an object was lost and found again.
        distance: Sum of 1 - similarity over all pairs.
        mostly_tracked: Objects tracked in at least 80 % of their frames.
        partially_tracked: Objects between the two.
        mostly_lost: Objects tracked in less than 20 %.
    """

    frames: int = 0
    objects: int = 0
    tracked: int = 0
    matches: int = 0
    switches: int = 0
    fragmentations: int = 0
    distance: float = 0.0
    mostly_tracked: int = 0
    partially_tracked: int = 0
    mostly_lost: int = 0

    def __add__(self, other: ClearScores) -> ClearScores:
        return ClearScores(
            **{one.name: getattr(self, one.name) + getattr(other, one.name) for one in fields(self)}
        )

    @property
    def false_positives(self) -> int:
        """Boxes of tracks that are no object."""
        return self.tracked - self.matches

    @property
    def misses(self) -> int:
        """Objects without a track, over all frames."""
        return self.objects - self.matches

    @property
    def mota(self) -> float:
        """1 - (misses + false positives + switches) / objects; NaN without objects."""
        wrong = self.misses + self.false_positives + self.switches
        return 1.0 - _share(wrong, self.objects)

    @property
    def motp(self) -> float:
        """Mean distance (1 - similarity) of the pairs; NaN without pairs."""
        return _share(self.distance, self.matches)

    @property
    def precision(self) -> float:
        """Share of the tracks' boxes that are an object; NaN without tracks."""
        return _share(self.matches, self.tracked)

    @property
    def recall(self) -> float:
        """Share of the objects that are tracked; NaN without objects."""
        return _share(self.matches, self.objects)


def match_over_time(frames: Iterable[TrackFrame], least: float = 0.5) -> FrameMatches:
    """Pair objects with tracks frame by frame; pairs of the past come first.

    Args:
        frames: The frames in order.
        least: Similarity from which a pair is allowed.
    """
    last: dict[int, int] = {}
    matches: FrameMatches = []
    for frame in frames:
        pairs = _match(frame, last, least)
        last.update(zip(frame.truth_ids[pairs[0]], frame.track_ids[pairs[1]], strict=True))
        matches.append(pairs)
    return matches


def _match(frame: TrackFrame, last: dict[int, int], least: float) -> _Pairs:
    column_of = {int(name): column for column, name in enumerate(frame.track_ids)}
    left = frame.similarity.copy()
    kept: dict[int, int] = {}
    for row, name in enumerate(frame.truth_ids):
        column = column_of.get(last[int(name)]) if int(name) in last else None
        if column is not None and left[row, column] >= least - np.finfo(np.float64).eps:
            kept[row] = column
            left[:, column] = -1.0
            left[row] = -1.0
    rows, columns = assign_rows(left, least)
    kept.update(zip(rows.tolist(), columns.tolist(), strict=True))
    order = sorted(kept)
    return np.array(order, np.intp), np.array([kept[row] for row in order], np.intp)


def clear_scores(frames: Sequence[TrackFrame], matches: FrameMatches) -> ClearScores:
    """Count what is right and wrong in a sequence.

    Args:
        frames: The frames in order.
        matches: The pairs of each, of `match_over_time`.
    """
    pairs = list(zip(frames, matches, strict=True))
    histories = _histories(frames, matches)
    shares = np.array([np.mean(history >= 0) for history in histories])
    lost, most = int((shares < MOSTLY[0]).sum()), int((shares >= MOSTLY[1]).sum())
    return ClearScores(
        frames=len(frames),
        objects=sum(len(frame.truth_ids) for frame in frames),
        tracked=sum(len(frame.track_ids) for frame in frames),
        matches=sum(len(rows) for rows, _ in matches),
        switches=sum(map(_switches, histories)),
        fragmentations=sum(map(_fragmentations, histories)),
        distance=float(sum((1.0 - f.similarity[rows, cols]).sum() for f, (rows, cols) in pairs)),
        mostly_tracked=most,
        partially_tracked=len(histories) - lost - most,
        mostly_lost=lost,
    )


def _histories(frames: Sequence[TrackFrame], matches: FrameMatches) -> list[NDArray[np.int64]]:
    """Return for each object the number of its track in each of its frames, or -1."""
    objects, _ = number_ids([frame.truth_ids for frame in frames])
    tracks, _ = number_ids([frame.track_ids for frame in frames])
    if not objects:
        return []
    partners = [np.full(len(part), -1, np.int64) for part in objects]
    for partner, names, (rows, columns) in zip(partners, tracks, matches, strict=True):
        partner[rows] = names[columns]
    everyone = np.concatenate(objects)
    order = np.argsort(everyone, kind="stable")
    ends = np.cumsum(np.bincount(everyone))[:-1]
    return np.split(np.concatenate(partners)[order], ends) if len(everyone) else []


def _switches(history: NDArray[np.int64]) -> int:
    return int((np.diff(history[history >= 0]) != 0).sum())


def _fragmentations(history: NDArray[np.int64]) -> int:
    """Count how often the object is lost between the first and the last frame it is tracked in."""
    seen = np.flatnonzero(history >= 0)
    return int((np.diff(seen) > 1).sum())


def _share(part: float, whole: int) -> float:
    return part / whole if whole else float("nan")
