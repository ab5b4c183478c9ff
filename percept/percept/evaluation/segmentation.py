"""How well ground and clusters agree with labels of points and with truth boxes.

Point-IoU recall, over- and under-segmentation follow the idea of TRAVEL (Oh et al. 2022): a box
is found when one cluster holds its points and little else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.evaluation.bands import RANGE_BANDS, range_band

__all__ = [
    "GroundScores",
    "ObjectScore",
    "SegmentationScores",
    "ground_scores",
    "points_in_box",
    "score_clusters",
]

_FLOOR_M = 0.2  # points lower than this above a box's bottom may be ground: they count for no one
_SPLIT_SHARE = 0.2  # a cluster with this share of an object's points is a piece of it


@dataclass(frozen=True, slots=True)
class GroundScores:
    """Precision, recall and F1 of ground labels, over the points that count."""

    precision: float
    recall: float
    f1: float
    points: int


@dataclass(frozen=True, slots=True)
class ObjectScore:
    """What became of one truth box.

    Attributes:
        label: Its class.
        range_m: Horizontal distance of its centre.
        points: Its points, without those near its bottom.
        iou: Largest point-IoU with a cluster; 0 when no cluster touches it.
        split: Whether two or more clusters hold a fifth of its points each.
        merged: Whether the best cluster has most of its points outside the box.
    """

    label: str
    range_m: float
    points: int
    iou: float
    split: bool
    merged: bool


@dataclass(frozen=True, slots=True)
class SegmentationScores:
    """Scores of all truth boxes with enough points; adds up over scenes."""

    objects: tuple[ObjectScore, ...] = ()

    def __add__(self, other: SegmentationScores) -> SegmentationScores:
        return SegmentationScores(self.objects + other.objects)

    def recall(self, min_iou: float = 0.5) -> float:
        """Return the share of boxes with a cluster of at least this point-IoU; NaN of none."""
        if not self.objects:
            return float("nan")
        return sum(entry.iou >= min_iou for entry in self.objects) / len(self.objects)

    def of(self, label: str | None = None, band: str | None = None) -> SegmentationScores:
        """Return the scores of one class, one range band, or both."""
        return SegmentationScores(
            tuple(
                entry
                for entry in self.objects
                if label in (None, entry.label) and band in (None, range_band(entry.range_m))
            )
        )

    def __str__(self) -> str:
        rows = [
            f"{'class':<22}{'range':<10}{'boxes':>6}{'found':>6}{'share':>7}{'split':>6}{'merged':>7}"
        ]
        labels = sorted({entry.label for entry in self.objects})
        places = [(label, band) for label in labels for band in (*RANGE_BANDS, None)]
        for label, band in [*places, *((None, band) for band in (*RANGE_BANDS, None))]:
            part = self.of(label, band)
            if part.objects:
                rows.append(f"{label or 'all':<22}{band or 'all':<10}{_counts(part)}")
        return "\n".join(rows)


def _counts(scores: SegmentationScores) -> str:
    found = sum(entry.iou >= 0.5 for entry in scores.objects)
    split = sum(entry.split for entry in scores.objects)
    merged = sum(entry.merged for entry in scores.objects)
    return f"{len(scores.objects):>6}{found:>6}{scores.recall():>7.2f}{split:>6}{merged:>7}"


def points_in_box(points: NDArray[np.floating], box_m: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return (N,) bool: which points (N, 3) lie in an upright box.

    Args:
        points: (N, 3) x, y, z, metres.
        box_m: (7,) centre x, y, z, length, width, height in metres, yaw in rad about z.
    """
    offset = np.asarray(points, dtype=np.float64)[:, :3] - box_m[:3]
    cosine, sine = np.cos(box_m[6]), np.sin(box_m[6])
    along = cosine * offset[:, 0] + sine * offset[:, 1]
    across = cosine * offset[:, 1] - sine * offset[:, 0]
    local = np.abs(np.stack([along, across, offset[:, 2]], axis=1))
    inside: NDArray[np.bool_] = (local <= np.asarray(box_m[3:6]) / 2.0).all(axis=1)
    return inside


def ground_scores(
    predicted: NDArray[np.bool_],
    truth: NDArray[np.bool_],
    counts: NDArray[np.bool_] | None = None,
) -> GroundScores:
    """Compare ground labels point by point.

    Args:
        predicted: (N,) bool, True where a point was taken for ground.
        truth: (N,) bool, True where it is.
        counts: (N,) bool, the points that count; None counts all. State the protocol with the
            figures: leaving out unlabelled points or vegetation moves F1 by points.

    Raises:
        GeometryError: If the columns have different lengths.
    """
    counts = np.ones(len(truth), bool) if counts is None else counts
    if not predicted.shape == truth.shape == counts.shape:
        raise GeometryError(
            f"ground labels differ in length: {predicted.shape}, {truth.shape}, {counts.shape}"
        )
    predicted, truth = predicted[counts], truth[counts]
    hits = float((predicted & truth).sum())
    precision = hits / predicted.sum() if predicted.any() else float("nan")
    recall = hits / truth.sum() if truth.any() else float("nan")
    f1 = 2.0 * hits / (predicted.sum() + truth.sum()) if (predicted | truth).any() else float("nan")
    return GroundScores(float(precision), float(recall), float(f1), len(truth))


def score_clusters(
    points: NDArray[np.floating],
    cluster_ids: NDArray[np.int32],
    boxes_m: NDArray[np.floating],
    labels: Sequence[str],
    min_points: int = 20,
) -> SegmentationScores:
    """Compare clusters with truth boxes by the points that they share.

    Points within 0.2 m of a box's bottom may be ground or object: they count neither for nor
    against it. What the ground stage took from an object above that counts against the clusters.

    Args:
        points: (N, 3) all points of the scan, ground included, metres.
        cluster_ids: (N,) int32 cluster of each point, -1 for ground and noise.
        boxes_m: (K, 7) truth boxes in the frame of the points.
        labels: K class names.
        min_points: Boxes with fewer points off the ground are not scored.

    Raises:
        GeometryError: If the columns have different lengths.
    """
    if len(points) != len(cluster_ids) or len(boxes_m) != len(labels):
        raise GeometryError(
            f"{len(points)} points with {len(cluster_ids)} clusters, "
            f"{len(boxes_m)} boxes with {len(labels)} labels"
        )
    sizes = np.bincount(cluster_ids[cluster_ids >= 0], minlength=1)
    objects = []
    for box_m, label in zip(boxes_m, labels, strict=True):
        inside = np.flatnonzero(points_in_box(points, box_m))
        counted = inside[points[inside, 2] > box_m[2] - box_m[5] / 2.0 + _FLOOR_M]
        if len(counted) >= min_points:
            low = np.setdiff1d(inside, counted, assume_unique=True)
            range_m = float(np.hypot(box_m[0], box_m[1]))
            iou, split, merged = _overlap(cluster_ids[counted], cluster_ids[low], sizes)
            objects.append(ObjectScore(label, range_m, len(counted), iou, split, merged))
    return SegmentationScores(tuple(objects))


def _overlap(
    counted: NDArray[np.int32], low: NDArray[np.int32], sizes: NDArray[np.intp]
) -> tuple[float, bool, bool]:
    """Return best IoU, split and merged of one box from the clusters of its points."""
    shared = np.bincount(counted[counted >= 0], minlength=len(sizes))
    uncounted = np.bincount(low[low >= 0], minlength=len(sizes))
    iou = shared / (len(counted) + sizes - uncounted - shared)
    best = int(np.argmax(iou))
    pieces = int((shared >= _SPLIT_SHARE * len(counted)).sum())
    outside = sizes[best] - uncounted[best] - shared[best]
    return float(iou[best]), pieces >= 2, bool(outside > shared[best])
