"""What networks and tracks say of a moment, and how much a label there would teach.

Three signs that a moment is worth a label, each in 0..1: a class that is rare, confidences near
the middle, and sensors or networks that do not agree (Settles, "Active Learning Literature
Survey", 2009, sections 3.1 and 3.2: uncertainty sampling and query by committee).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["FrameEvidence", "label_counts", "rarity", "strength", "uncertainty"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameEvidence:
    """What is known of one moment before anybody labels it.

    Attributes:
        stamp_ns: The moment.
        labels: Class of each object that was found, over all cameras and LiDARs.
        confidences: (N,) float64 in 0..1 of each; NaN where there is none.
        disagreement: Share of the objects that not all of those who should have seen them did
            see, 0..1; 0 where only one looked.
        track_ids: (N,) int64 the object's number in its drive; -1 where it has none. None where
            no object has one.

    Raises:
        GeometryError: If columns do not have one value for each label, or a share is none.
    """

    stamp_ns: int
    labels: tuple[str, ...]
    confidences: NDArray[np.float64]
    disagreement: float = 0.0
    track_ids: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        shapes = [
            self.confidences.shape,
            *([] if self.track_ids is None else [self.track_ids.shape]),
        ]
        if any(shape != (len(self.labels),) for shape in shapes):
            raise GeometryError(
                f"{len(self.labels)} labels need as many confidences and tracks, not {shapes}"
            )
        if not 0.0 <= self.disagreement <= 1.0:
            raise GeometryError(f"a disagreement is a share, not {self.disagreement}")


def label_counts(evidence: Iterable[FrameEvidence]) -> Counter[str]:
    """Return how often each class was found."""
    return Counter(label for moment in evidence for label in moment.labels)


def rarity(moment: FrameEvidence, counts: Mapping[str, int]) -> float:
    """Return how rare the rarest class of a moment is, 0..1; 0 without objects.

    1 for a class that was found once; 0 for one that all objects are of: one minus the logarithm
    of its count over that of all counts.
    """
    total = sum(counts.values())
    if not moment.labels or total <= 1:
        return 0.0
    rarest = min(counts.get(label, 1) for label in moment.labels)
    return float(1.0 - np.log(max(rarest, 1)) / np.log(total))


def uncertainty(moment: FrameEvidence) -> float:
    """Return how unsure the confidences are on average: one is 1 at one half, 0 at 0 and 1.

    The mean over the objects, since among many there is always one that is unsure (Brust et al.,
    "Active Learning for Deep Object Detection", 2019, section 3.2).
    """
    known = moment.confidences[np.isfinite(moment.confidences)]
    if not len(known):
        return 0.0
    return float(np.clip(1.0 - 2.0 * np.abs(known - 0.5), 0.0, 1.0).mean())


def strength(moment: FrameEvidence, counts: Mapping[str, int]) -> float:
    """Return how much a label would teach, 0..1: the mean of the three signs.

    Args:
        moment: The moment.
        counts: How often each class was found, from `label_counts`.
    """
    return (rarity(moment, counts) + uncertainty(moment) + moment.disagreement) / 3.0
