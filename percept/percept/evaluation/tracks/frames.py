"""What every tracking metric works on: who is there, who is tracked, and how alike they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.core.errors import InputError
from percept.core.tracked_boxes import TrackedBoxes

__all__ = ["Similarity", "TrackFrame", "assign_rows", "frame_slices", "number_ids", "pair_frames"]

_EPSILON = float(np.finfo(np.float64).eps)

_F64 = NDArray[np.float64]
Similarity = Callable[[TrackedBoxes, TrackedBoxes], _F64]
"""Gives the similarity (N, M) in 0..1 of N truth boxes with M tracks of one frame."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackFrame:
    """One frame.

    Attributes:
        truth_ids: (N,) int64 of the objects that are there.
        track_ids: (M,) int64 of the tracks.
        similarity: (N, M) float64 in 0..1, such as the IoU of their boxes.
    """

    truth_ids: NDArray[np.int64]
    track_ids: NDArray[np.int64]
    similarity: _F64


def pair_frames(
    truth: TrackedBoxes, tracks: TrackedBoxes, similarity: Similarity
) -> list[TrackFrame]:
    """Return every frame that either side names, in order.

    The rows of both sides keep their order, so that row k of a side is the k-th of all frames.

    Args:
        truth: What is there.
        tracks: What was tracked.
        similarity: How alike the boxes of a frame are.

    Raises:
        InputError: If an identity comes twice in a frame.
    """
    numbers = np.union1d(truth.frames, tracks.frames)
    there, tracked = frame_slices(truth.frames, numbers), frame_slices(tracks.frames, numbers)
    return [
        _frame(truth.select(rows), tracks.select(track_rows), similarity)
        for rows, track_rows in zip(there, tracked, strict=True)
    ]


def frame_slices(
    frames: NDArray[np.int64], numbers: NDArray[np.int64]
) -> Iterator[NDArray[np.intp]]:
    """Return the rows of each frame.

    Args:
        frames: (R,) int64 never falling.
        numbers: (F,) int64 rising: the frames to look for.
    """
    starts = np.searchsorted(frames, numbers, side="left")
    ends = np.searchsorted(frames, numbers, side="right")
    return (np.arange(start, end) for start, end in zip(starts, ends, strict=True))


def _frame(truth: TrackedBoxes, tracks: TrackedBoxes, similarity: Similarity) -> TrackFrame:
    for name, boxes in (("labels", truth), ("tracks", tracks)):
        ids, counts = np.unique(boxes.ids, return_counts=True)
        if (counts > 1).any():
            raise InputError(
                f"id {ids[counts > 1][0]} comes twice in frame {boxes.frames[0]} of the {name}"
            )
    return TrackFrame(truth.ids, tracks.ids, similarity(truth, tracks))


def assign_rows(similarity: _F64, least: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pair rows and columns: as many as are alike enough, and of those the most alike in sum.

    Args:
        similarity: (N, M) float64 in 0..1.
        least: Similarity from which a pair is allowed.

    Returns:
        Rows and columns of the pairs, both (K,), rows rising.
    """
    allowed = similarity >= least - _EPSILON
    rows, columns = np.nonzero(allowed)
    if len(np.unique(rows)) == len(rows) and len(np.unique(columns)) == len(columns):
        return rows, columns  # nobody has a choice
    far = 2.0 * min(similarity.shape) + 1.0  # dearer than any number of pairs that are allowed
    rows, columns = linear_sum_assignment(np.where(allowed, 1.0 - similarity, far))
    kept = allowed[rows, columns]
    return rows[kept], columns[kept]


def number_ids(
    ids: Sequence[NDArray[np.int64]],
) -> tuple[list[NDArray[np.intp]], int]:
    """Return identities as numbers from 0, frame by frame, and how many there are."""
    if not ids:
        return [], 0
    known, numbers = np.unique(np.concatenate(ids), return_inverse=True)
    return np.split(numbers, np.cumsum([len(part) for part in ids])[:-1]), len(known)
