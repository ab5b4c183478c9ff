"""IDF1 (Ristani et al., 2016, ECCVW): how long each object is the one track that suits it best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from percept.evaluation.tracks.frames import TrackFrame, number_ids

__all__ = ["IdentityScores", "identity_scores"]


@dataclass(frozen=True, slots=True)
class IdentityScores:
    """Counts that add up over sequences.

    Attributes:
        objects: Boxes of the truth, over all frames.
        tracked: Boxes of tracks.
        matches: Frames in which an object and the track that is assigned to it for the whole
            sequence are alike enough (IDTP).
    """

    objects: int = 0
    tracked: int = 0
    matches: int = 0

    def __add__(self, other: IdentityScores) -> IdentityScores:
        return IdentityScores(
            self.objects + other.objects,
            self.tracked + other.tracked,
            self.matches + other.matches,
        )

    @property
    def idp(self) -> float:
        """Share of the tracks' boxes that have the right identity; NaN without tracks."""
        return self.matches / self.tracked if self.tracked else float("nan")

    @property
    def idr(self) -> float:
        """Share of the objects that have the right identity; NaN without objects."""
        return self.matches / self.objects if self.objects else float("nan")

    @property
    def idf1(self) -> float:
        """Harmonic mean of the two; NaN with neither objects nor tracks."""
        both = self.objects + self.tracked
        return 2.0 * self.matches / both if both else float("nan")


def identity_scores(frames: Sequence[TrackFrame], least: float = 0.5) -> IdentityScores:
    """Assign tracks to objects once for the whole sequence, and count the frames that agree.

    Args:
        frames: The frames in order.
        least: Similarity from which a pair counts.
    """
    truth, objects = number_ids([frame.truth_ids for frame in frames])
    tracks, names = number_ids([frame.track_ids for frame in frames])
    together = np.zeros((objects, names), np.int64)
    for frame, rows, columns in zip(frames, truth, tracks, strict=True):
        alike = frame.similarity >= least - np.finfo(np.float64).eps
        together[np.ix_(rows, columns)] += alike
    pairs = linear_sum_assignment(together, maximize=True)
    return IdentityScores(
        objects=sum(map(len, truth)),
        tracked=sum(map(len, tracks)),
        matches=int(together[pairs].sum()),
    )
