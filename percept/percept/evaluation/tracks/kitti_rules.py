"""What counts in KITTI's tracking benchmark.

Objects of a neighbouring class, truncated ones and those of unknown occlusion are neither found
nor missed. A track's box that is no object is excused where it is no higher than 25 px, or lies
for more than half in a region that nobody labelled. Each frame is assigned anew.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.frames import (
    Similarity,
    TrackFrame,
    assign_rows,
    frame_slices,
    number_ids,
    pair_frames,
)
from percept.evaluation.tracks.kitti_counts import KittiCounts, ObjectHistories
from percept.evaluation.tracks.similarity import image_overlap

__all__ = ["KITTI_CLASSES", "KittiSequence"]

KITTI_CLASSES: dict[str, tuple[str, ...]] = {
    "Car": ("Van",),
    "Pedestrian": ("Person", "Person_sitting"),
    "Cyclist": (),
}
"""The classes that are scored, each with its neighbours, which are neither right nor wrong."""

_DONT_CARE = "DontCare"
_LEAST_HEIGHT_PX = 25.0
_MOST_OCCLUDED = 2
_MOST_IN_DONT_CARE = 0.5

_B = NDArray[np.bool_]
_F64 = NDArray[np.float64]
_Rows = NDArray[np.intp]


class KittiSequence:
    """One class of one sequence, ready to be scored at any threshold of the tracks' scores.

    Args:
        truth: The labels of all classes, `DontCare` among them.
        tracks: The tracks of all classes; the score of a track is the mean of its boxes'.
        label: One of `KITTI_CLASSES`.
        similarity: IoU in space, or in the image.
        least: Similarity from which a pair is allowed.

    Attributes:
        objects: Number of boxes of the truth that count.

    Raises:
        InputError: If an identity comes twice in a frame.
    """

    def __init__(
        self,
        truth: TrackedBoxes,
        tracks: TrackedBoxes,
        label: str,
        similarity: Similarity,
        least: float,
    ) -> None:
        there = truth.labelled(label, *KITTI_CLASSES[label])
        made = tracks.labelled(label)
        self._frames = pair_frames(there, made, similarity)
        self._least = least
        self._ignored = _ignored(there, label)
        self._excused = _excused(made, truth.labelled(_DONT_CARE))
        self._scores = _mean_by_id(made.ids, made.scores)
        self._objects = _numbers(there.ids)
        self._tracks = _numbers(made.ids)
        self._rows = _rows([len(frame.truth_ids) for frame in self._frames])
        self._track_rows = _rows([len(frame.track_ids) for frame in self._frames])
        self._known: dict[tuple[int, int], tuple[_Rows, _Rows, _F64]] = {}
        self.objects = int((~self._ignored).sum())

    def hit_scores(self) -> _F64:
        """Return the score of the track of each object that is found, without a threshold."""
        partners, _ = self._match(-np.inf)
        return np.asarray(self._scores[partners[(partners >= 0) & ~self._ignored]])

    def counts(self, least_score: float = -np.inf) -> KittiCounts:
        """Count what is right and wrong with the tracks from a score on."""
        partners, overlaps = self._match(least_score)
        hit = (partners >= 0) & ~self._ignored
        tracks = np.full(len(partners), -1, np.int64)
        tracks[partners >= 0] = self._tracks[partners[partners >= 0]]
        histories = ObjectHistories(self._objects, tracks, self._ignored)
        most, partly, lost = histories.mostly()
        return KittiCounts(
            objects=self.objects,
            matches=int(hit.sum()),
            false_positives=int((self._alone(partners, least_score) & ~self._excused).sum()),
            switches=histories.switches(),
            fragmentations=histories.fragmentations(),
            overlap=float(overlaps[hit].sum()),
            mostly_tracked=most,
            partially_tracked=partly,
            mostly_lost=lost,
        )

    def frames(self, least_score: float = -np.inf) -> list[TrackFrame]:
        """Return the frames with what counts alone, for other metrics."""
        partners, _ = self._match(least_score)
        wanted = self._alone(partners, least_score) & ~self._excused
        wanted[partners[(partners >= 0) & ~self._ignored]] = True
        frames = []
        for frame, rows, columns in zip(self._frames, self._rows, self._track_rows, strict=True):
            there, made = ~self._ignored[rows], wanted[columns]
            similarity = frame.similarity[np.ix_(there, made)]
            frames.append(TrackFrame(frame.truth_ids[there], frame.track_ids[made], similarity))
        return frames

    def _alone(self, partners: _Rows, least_score: float) -> _B:
        alone = self._scores >= least_score
        alone[partners[partners >= 0]] = False
        return np.asarray(alone)

    def _match(self, least_score: float) -> tuple[_Rows, _F64]:
        """Return for each row of the truth the row of its track or -1, and their similarity."""
        partners, overlaps = np.full(len(self._ignored), -1, np.intp), np.zeros(len(self._ignored))
        kept = self._scores >= least_score
        for k, (rows, columns) in enumerate(zip(self._rows, self._track_rows, strict=True)):
            if len(rows) and len(columns):
                chosen = np.flatnonzero(kept[columns])
                pairs, others, overlap = self._pairs(k, chosen)
                partners[rows[pairs]] = columns[others]
                overlaps[rows[pairs]] = overlap
        return partners, overlaps

    def _pairs(self, k: int, chosen: _Rows) -> tuple[_Rows, _Rows, _F64]:
        # Thresholds take away the lowest scores first: a frame has one set of tracks for a number.
        if (k, len(chosen)) not in self._known:
            similarity = self._frames[k].similarity
            rows, columns = assign_rows(similarity[:, chosen], self._least)
            self._known[k, len(chosen)] = (
                rows, chosen[columns], similarity[rows, chosen[columns]]
            )  # fmt: skip
        return self._known[k, len(chosen)]


def _ignored(truth: TrackedBoxes, label: str) -> _B:
    neighbour = np.array([name != label for name in truth.labels], dtype=np.bool_)
    return np.asarray(neighbour | (truth.truncated > 0) | (truth.occluded > _MOST_OCCLUDED))


def _excused(tracks: TrackedBoxes, dont_care: TrackedBoxes) -> _B:
    """Return which boxes of tracks are no mistake although they are no object."""
    excused = np.abs(tracks.boxes_px[:, 3] - tracks.boxes_px[:, 1]) <= _LEAST_HEIGHT_PX
    numbers = np.unique(tracks.frames)
    regions = frame_slices(dont_care.frames, numbers)
    for rows, others in zip(frame_slices(tracks.frames, numbers), regions, strict=True):
        inside = image_overlap(tracks.boxes_px[rows], dont_care.boxes_px[others])
        excused[rows] |= (inside > _MOST_IN_DONT_CARE).any(axis=1)
    return np.asarray(excused)


def _mean_by_id(ids: NDArray[np.int64], scores: _F64) -> _F64:
    numbers = _numbers(ids)
    return np.asarray((np.bincount(numbers, scores) / np.bincount(numbers))[numbers])


def _numbers(ids: NDArray[np.int64]) -> _Rows:
    (numbers,), _ = number_ids([ids])
    return numbers


def _rows(lengths: list[int]) -> list[_Rows]:
    return np.split(np.arange(sum(lengths)), np.cumsum(lengths)[:-1]) if lengths else []
