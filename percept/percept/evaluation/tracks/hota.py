"""HOTA (Luiten et al., 2021, IJCV): detection and association in one figure, over similarities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.evaluation.tracks.frames import TrackFrame, number_ids

__all__ = ["ALPHAS", "HotaScores", "hota_scores"]

ALPHAS = np.arange(0.05, 0.99, 0.05)
"""Similarities from which a pair counts; every figure is the mean over these 19."""

_EPSILON = np.finfo(np.float64).eps

_F64 = NDArray[np.float64]


def _zeros() -> _F64:
    return np.zeros(len(ALPHAS))


@dataclass(frozen=True, slots=True, eq=False)
class HotaScores:
    """Sums that add up over sequences.

    Attributes:
        objects: Boxes of the truth, over all frames.
        tracked: Boxes of tracks.
        matches: (19,) float64 pairs at each of `ALPHAS`.
        association: (19,) float64 sum over the pairs of how well the rest of their two
            identities agrees (equation 12).
        similarity: (19,) float64 sum of the similarity of the pairs.
    """

    objects: int = 0
    tracked: int = 0
    matches: _F64 = field(default_factory=_zeros)
    association: _F64 = field(default_factory=_zeros)
    similarity: _F64 = field(default_factory=_zeros)

    def __add__(self, other: HotaScores) -> HotaScores:
        return HotaScores(
            self.objects + other.objects,
            self.tracked + other.tracked,
            self.matches + other.matches,
            self.association + other.association,
            self.similarity + other.similarity,
        )

    @property
    def hota(self) -> float:
        """Geometric mean of detection and association, averaged over `ALPHAS`."""
        return float(np.sqrt(self._detection() * self._association()).mean())

    @property
    def det_a(self) -> float:
        """Detection: pairs over objects and tracks together (Jaccard index)."""
        return float(self._detection().mean())

    @property
    def ass_a(self) -> float:
        """Association: the same of the identities' frames, averaged over the pairs."""
        return float(self._association().mean())

    @property
    def loc_a(self) -> float:
        """Mean similarity of the pairs; 1 where there are none, as the authors' code has it."""
        pairs = np.maximum(self.matches, 1e-10)
        return float((np.maximum(self.similarity, 1e-10) / pairs).mean())

    def _detection(self) -> _F64:
        return self.matches / np.maximum(1, self.objects + self.tracked - self.matches)

    def _association(self) -> _F64:
        return self.association / np.maximum(1, self.matches)


def hota_scores(frames: Sequence[TrackFrame]) -> HotaScores:
    """Score a sequence.

    Pairs are assigned frame by frame, those first whose identities agree over the whole
    sequence, and each of them counts at every alpha that its similarity reaches.

    Args:
        frames: The frames in order.
    """
    truth, objects = number_ids([frame.truth_ids for frame in frames])
    tracks, names = number_ids([frame.track_ids for frame in frames])
    totals = HotaScores(objects=sum(map(len, truth)), tracked=sum(map(len, tracks)))
    if not totals.objects or not totals.tracked:
        return totals
    lives = np.bincount(np.concatenate(truth), minlength=objects)
    spans = np.bincount(np.concatenate(tracks), minlength=names)
    alignment = _alignment(frames, truth, tracks, lives, spans)
    pairs, similarity = _pairs(frames, truth, tracks, alignment)
    return totals + _sums(pairs, similarity, lives, spans)


def _alignment(
    frames: Sequence[TrackFrame],
    truth: list[NDArray[np.intp]],
    tracks: list[NDArray[np.intp]],
    lives: NDArray[np.intp],
    spans: NDArray[np.intp],
) -> _F64:
    """Return how much each object and each track agree over the sequence (K, L), in 0..1."""
    shared = np.zeros((len(lives), len(spans)))
    for frame, rows, columns in zip(frames, truth, tracks, strict=True):
        alike = frame.similarity
        both = alike.sum(axis=0)[None, :] + alike.sum(axis=1)[:, None] - alike
        shared[np.ix_(rows, columns)] += np.divide(
            alike, both, out=np.zeros_like(alike), where=both > _EPSILON
        )
    return shared / (lives[:, None] + spans[None, :] - shared)


def _pairs(
    frames: Sequence[TrackFrame],
    truth: list[NDArray[np.intp]],
    tracks: list[NDArray[np.intp]],
    alignment: _F64,
) -> tuple[NDArray[np.intp], _F64]:
    """Return object and track (K, 2) of the pairs of all frames, and their similarity (K,)."""
    pairs, similarity = [np.zeros((0, 2), np.intp)], [np.zeros(0)]
    for frame, names, others in zip(frames, truth, tracks, strict=True):
        worth = alignment[np.ix_(names, others)] * frame.similarity
        rows, columns = linear_sum_assignment(worth, maximize=True)
        pairs.append(np.column_stack([names[rows], others[columns]]))
        similarity.append(frame.similarity[rows, columns])
    return np.concatenate(pairs), np.concatenate(similarity)


def _sums(
    pairs: NDArray[np.intp], similarity: _F64, lives: NDArray[np.intp], spans: NDArray[np.intp]
) -> HotaScores:
    """Return the sums over the pairs that count, for each alpha."""
    kinds, kind_of = np.unique(pairs, axis=0, return_inverse=True)
    either = lives[kinds[:, 0]] + spans[kinds[:, 1]]
    sums = HotaScores()
    for k, alpha in enumerate(ALPHAS):
        counts = similarity >= alpha - _EPSILON
        together = np.bincount(kind_of[counts], minlength=len(kinds))
        sums.matches[k] = counts.sum()
        sums.association[k] = (together * together / np.maximum(1, either - together)).sum()
        sums.similarity[k] = similarity[counts].sum()
    return sums
