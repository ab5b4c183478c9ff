"""Counts of KITTI's tracking benchmark, and how identities over time become counts.

Here an identity switch needs the object to be tracked in two labelled frames that follow each
other: one across a gap is none (`clear_scores` counts those too).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.tracks.clear import MOSTLY

__all__ = ["KittiCounts", "ObjectHistories"]

_I = NDArray[np.int64]
_B = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class KittiCounts:
    """Counts that add up over sequences.

    Attributes:
        objects: Boxes of the truth that count.
        matches: Those with a track.
        false_positives: Boxes of tracks that are no object, without those that are excused.
        switches: Identity switches between labelled frames that follow each other.
        fragmentations: How often the track of an object ends while it is still there, or
            changes.
        overlap: Sum of the similarity of the pairs.
        mostly_tracked: Objects tracked in more than 80 % of the frames that count.
        partially_tracked: Objects between the two.
        mostly_lost: Objects tracked in less than 20 %.
    """

    objects: int = 0
    matches: int = 0
    false_positives: int = 0
    switches: int = 0
    fragmentations: int = 0
    overlap: float = 0.0
    mostly_tracked: int = 0
    partially_tracked: int = 0
    mostly_lost: int = 0

    def __add__(self, other: KittiCounts) -> KittiCounts:
        return KittiCounts(
            **{one.name: getattr(self, one.name) + getattr(other, one.name) for one in fields(self)}
        )

    @property
    def misses(self) -> int:
        """Objects without a track, over all frames."""
        return self.objects - self.matches

    @property
    def mota(self) -> float:
        """1 - (misses + false positives + switches) / objects; NaN without objects."""
        wrong = self.misses + self.false_positives + self.switches
        return 1.0 - wrong / self.objects if self.objects else float("nan")

    @property
    def motp(self) -> float:
        """Mean similarity of the pairs; 0 without pairs."""
        return self.overlap / self.matches if self.matches else 0.0

    @property
    def recall(self) -> float:
        """Share of the objects that are tracked; NaN without objects."""
        return self.matches / self.objects if self.objects else float("nan")

    @property
    def precision(self) -> float:
        """Share of the tracks' boxes that are an object; NaN without any that count."""
        made = self.matches + self.false_positives
        return self.matches / made if made else float("nan")


class ObjectHistories:
    """The frames of all objects, one object after the other.

    Args:
        objects: (R,) number of the object of each row.
        tracks: (R,) number of its track, or -1.
        ignored: (R,) whether the row does not count; nothing is compared across it.
    """

    def __init__(self, objects: NDArray[np.intp], tracks: _I, ignored: _B) -> None:
        order = np.argsort(objects, kind="stable")
        self._objects, self._tracks, self._ignored = objects[order], tracks[order], ignored[order]
        self._goes_on = self._objects[1:] == self._objects[:-1]

    def switches(self) -> int:
        """Count changes of the track from a frame to the object's next."""
        before, here = self._tracks[:-1], self._tracks[1:]
        seen = (before >= 0) & (here >= 0) & ~self._ignored[:-1] & ~self._ignored[1:]
        return int((self._goes_on & seen & (before != here)).sum())

    def fragmentations(self) -> int:
        """Count how often an object that was tracked gets a track again for at least two frames.

        At the end of its life one frame is enough.
        """
        place = np.arange(len(self._tracks))
        first = np.concatenate([[True], ~self._goes_on])[: len(place)]
        starts = np.maximum.accumulate(np.where(first, place, 0))
        tracked = (self._tracks >= 0) & ~self._ignored
        last_tracked = np.maximum.accumulate(np.where(tracked, place, -1))[:-1]
        last_ignored = np.maximum.accumulate(np.where(self._ignored, place, -1))[:-1]
        known = last_tracked >= np.maximum(starts[1:], last_ignored + 1)
        changed = self._goes_on & (self._tracks[1:] != self._tracks[:-1]) & tracked[1:]
        stays = np.append(~self._goes_on[1:] | (self._tracks[2:] >= 0), [True])[: len(changed)]
        return int((changed & known & stays).sum())

    def mostly(self) -> tuple[int, int, int]:
        """Return how many objects are mostly tracked, partially tracked and mostly lost."""
        counted = ~self._ignored
        lives = np.bincount(self._objects[counted])
        tracked = np.bincount(self._objects[counted & (self._tracks >= 0)], minlength=len(lives))
        shares = tracked[lives > 0] / lives[lives > 0]
        most, lost = int((shares > MOSTLY[1]).sum()), int((shares < MOSTLY[0]).sum())
        return most, len(shares) - most - lost, lost
