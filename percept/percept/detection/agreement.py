"""How far two networks say the same: a quantised one, and the one that it was made of.

There is no truth in it: what the first network finds is what the second is expected to find.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D, Verdict
from percept.detection.yolo import YoloDetector

__all__ = ["Agreement", "Picture", "compare_detectors", "judge_agreement"]

Picture: TypeAlias = NDArray[np.uint8]
"""(H, W, 3) uint8 BGR."""

# The limits of the verdict. In 8 bits the published networks lose 1 to 3 points of mAP at 0.5, and
# about as many of their boxes change; those whose layers do not take it lose a fifth or far more.
GOOD_SHARE_50: Final = 0.95
GOOD_SHARE_75: Final = 0.90
BAD_SHARE_50: Final = 0.80
GOOD_SHIFT: Final = 0.03
BAD_SHIFT: Final = 0.10
LEAST_BOXES: Final = 30
LEAST_SPEED: Final = 1.1


@dataclass(slots=True)
class Agreement:
    """What two networks find in the same images.

    Attributes:
        images: Images that both looked at.
        boxes: Boxes of the first network.
        boxes_other: Boxes of the second.
        matched_50: Pairs of one class with an intersection over union of 0.5 or more.
        matched_75: Those with 0.75 or more.
        shifts: Confidence of the second less that of the first, for each pair.
        ms: Milliseconds of the first network alone, for each image.
        ms_other: Those of the second.
    """

    images: int = 0
    boxes: int = 0
    boxes_other: int = 0
    matched_50: int = 0
    matched_75: int = 0
    shifts: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    ms_other: list[float] = field(default_factory=list)

    @property
    def share_50(self) -> float:
        """Of all boxes of both networks, the share that the other has too; 1 without boxes."""
        return self._share(self.matched_50)

    @property
    def share_75(self) -> float:
        """The same with boxes that fit to 0.75."""
        return self._share(self.matched_75)

    def _share(self, matched: int) -> float:
        boxes = self.boxes + self.boxes_other
        return 2 * matched / boxes if boxes else 1.0

    @property
    def mean_shift(self) -> float:
        """Mean change of the confidence; 0 without pairs."""
        return statistics.fmean(self.shifts) if self.shifts else 0.0

    @property
    def speed(self) -> float:
        """How many times as fast the second network is: the median over the images."""
        ratios = [a / b for a, b in zip(self.ms, self.ms_other, strict=True)]
        return statistics.median(ratios) if ratios else 1.0

    def to_dict(self) -> dict[str, Any]:
        """Return all figures in the types of JSON."""
        changes = np.abs(self.shifts or [0.0])
        return {
            "images": self.images,
            "boxes_float": self.boxes,
            "boxes_int8": self.boxes_other,
            "share_iou_50": round(self.share_50, 4),
            "share_iou_75": round(self.share_75, 4),
            "confidence_shift": round(self.mean_shift, 4),
            "confidence_change_p95": round(float(np.percentile(changes, 95)), 4),
            "speed": round(self.speed, 3),
            "ms_float": round(statistics.median(self.ms or [0.0]), 2),
            "ms_int8": round(statistics.median(self.ms_other or [0.0]), 2),
        }


def compare_detectors(
    first: YoloDetector, other: YoloDetector, images: Iterable[Picture]
) -> Agreement:
    """Show images to two networks in turns, so that a busy machine slows both alike.

    Args:
        first: What is expected.
        other: What is judged.
        images: Read once, one by one.
    """
    result = Agreement()
    for image in images:
        tensor, _ = first.prepare(image)
        if not result.images:
            # The first run of a network allocates its memory.
            _milliseconds(first, tensor)
            _milliseconds(other, tensor)
        result.ms.append(_milliseconds(first, tensor))
        result.ms_other.append(_milliseconds(other, tensor))
        _add(result, first.detect_one(image)[0], other.detect_one(image)[0])
    return result


def _milliseconds(detector: YoloDetector, tensor: NDArray[Any]) -> float:
    start = time.perf_counter()
    detector.network.run(tensor)
    return 1e3 * (time.perf_counter() - start)


def _add(result: Agreement, first: Detections2D, other: Detections2D) -> None:
    result.images += 1
    result.boxes += len(first)
    result.boxes_other += len(other)
    for i, j, overlap in _pairs(first, other):
        result.matched_50 += 1
        result.matched_75 += overlap >= 0.75
        result.shifts.append(float(other.confidences[j] - first.confidences[i]))


def _pairs(first: Detections2D, other: Detections2D) -> list[tuple[int, int, float]]:
    """Pair boxes of one class, each once, the surest first with what fits it best."""
    overlaps = _overlaps(first.boxes_px, other.boxes_px)
    labels = np.array(other.labels)
    pairs = []
    for i in np.argsort(-first.confidences, kind="stable"):
        fits = np.where(labels == first.labels[i], overlaps[i], 0.0) if len(other) else np.zeros(1)
        j = int(fits.argmax())
        if fits[j] >= 0.5:
            pairs.append((int(i), j, float(fits[j])))
            overlaps[:, j] = 0.0
    return pairs


def _overlaps(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the intersection over union (N, M) of boxes (N, 4) and (M, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(axis=1) for boxes in (a, b)]
    union: NDArray[np.float64] = areas[0][:, None] + areas[1] - shared
    overlaps: NDArray[np.float64] = np.zeros_like(union)
    np.divide(shared, union, out=overlaps, where=union > 0)
    return overlaps


def judge_agreement(found: Agreement) -> tuple[Verdict, tuple[str, ...]]:
    """Judge a quantised network by what it agrees on with the one that it was made of.

    Returns:
        `good`, `doubtful` or `bad`, and the reasons for less than good.
    """
    bad, doubtful = [], []
    shares = f"{found.share_50:.0%} of the boxes agree at IoU 0.5, {found.share_75:.0%} at 0.75"
    if found.share_50 < BAD_SHARE_50:
        bad.append(f"only {shares}")
    elif found.share_50 < GOOD_SHARE_50 or found.share_75 < GOOD_SHARE_75:
        doubtful.append(shares)
    shift = f"confidences are {found.mean_shift:+.3f} off in the mean"
    if abs(found.mean_shift) > BAD_SHIFT:
        bad.append(shift)
    elif abs(found.mean_shift) > GOOD_SHIFT:
        doubtful.append(shift)
    if found.boxes < LEAST_BOXES:
        doubtful.append(f"only {found.boxes} boxes to compare")
    if found.speed < LEAST_SPEED:
        doubtful.append(f"{found.speed:.2f} times as fast here: nothing is gained")
    if bad:
        return Verdict.BAD, (*bad, *doubtful)
    return (Verdict.DOUBTFUL if doubtful else Verdict.GOOD), tuple(doubtful)
