"""sAMOTA, AMOTA and AMOTP: tracking over 40 recalls (Weng et al., 2020, IROS, section IV)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.tracks.kitti_counts import KittiCounts
from percept.evaluation.tracks.kitti_rules import KittiSequence

__all__ = ["RecallScores", "score_recalls"]

_RECALLS = np.arange(1, 41) / 40


@dataclass(frozen=True, slots=True)
class RecallScores:
    """One class over all recalls.

    A recall that is not reached counts as 0, as the authors have it; the one just above the
    highest that is reached counts with all tracks.

    Attributes:
        samota: Mean of MOTA scaled by the highest that a recall allows, in 0..1.
        amota: Mean of MOTA.
        amotp: Mean of MOTP, the mean similarity of the pairs.
        best: The counts at the score with the highest MOTA.
        best_score: That score; tracks with a lower mean score are left out there.
        curve: (recall, MOTA, scaled MOTA) of each recall that is reached.
    """

    samota: float
    amota: float
    amotp: float
    best: KittiCounts
    best_score: float
    curve: tuple[tuple[float, float, float], ...]


def score_recalls(sequences: Sequence[KittiSequence]) -> RecallScores:
    """Score one class over all sequences with the lowest scores left out, recall by recall.

    Args:
        sequences: The class in each sequence; there must be an object that counts.
    """
    objects = sum(sequence.objects for sequence in sequences)
    scores = np.concatenate([np.zeros(0), *(sequence.hit_scores() for sequence in sequences)])
    curve, precision = [], 0.0
    best, best_score = _counts(sequences, -np.inf), -np.inf
    for recall, threshold in _thresholds(scores, objects):
        counts = _counts(sequences, threshold)
        curve.append((recall, counts.mota, _scaled_mota(counts, recall)))
        precision += counts.motp
        if counts.mota > best.mota or not math.isfinite(best_score):
            best, best_score = counts, threshold
    return RecallScores(
        samota=sum(scaled for *_, scaled in curve) / len(_RECALLS),
        amota=sum(mota for _, mota, _ in curve) / len(_RECALLS),
        amotp=precision / len(_RECALLS),
        best=best,
        best_score=best_score,
        curve=tuple(curve),
    )


def _counts(sequences: Sequence[KittiSequence], least_score: float) -> KittiCounts:
    return sum((sequence.counts(least_score) for sequence in sequences), KittiCounts())


def _scaled_mota(counts: KittiCounts, recall: float) -> float:
    """Return MOTA without the misses that a recall cannot do without (equation 4), in 0..1."""
    wrong = counts.misses + counts.false_positives + counts.switches
    allowed = (1.0 - recall) * counts.objects
    return min(1.0, max(0.0, 1.0 - (wrong - allowed) / (recall * counts.objects)))


def _thresholds(scores: NDArray[np.float64], objects: int) -> list[tuple[float, float]]:
    """Return for each recall that is reached the score at which the recall is nearest to it."""
    ranked = np.sort(scores)[::-1]
    found: list[tuple[float, float]] = []
    place = -1
    for recall in _RECALLS.tolist():
        if place >= len(ranked) - 1:
            break
        place = min(max(math.ceil(recall * objects - 0.5) - 1, 0), len(ranked) - 1)
        found.append((recall, float(ranked[place])))
    return found
