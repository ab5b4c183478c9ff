"""What the scores of 2D boxes are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict

__all__ = ["AveragePrecision", "BoxScores", "ClassScore", "Counts", "ImageMistakes"]


@dataclass(frozen=True, slots=True)
class Counts:
    """Objects, detections, and how many of the detections are an object, at one threshold.

    Attributes:
        objects: Labelled objects that count.
        detections: Detections that count; None where it is not known which belong here.
        hits: Detections that are one of the objects; never more than either.
    """

    objects: int
    detections: int | None
    hits: int

    @property
    def precision(self) -> float:
        """Share of the detections that are an object; NaN without detections."""
        return self.hits / self.detections if self.detections else float("nan")

    @property
    def recall(self) -> float:
        """Share of the objects that were found; NaN without objects."""
        return self.hits / self.objects if self.objects else float("nan")

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; NaN without objects and detections."""
        if self.detections is None or not self.objects + self.detections:
            return float("nan")
        return 2 * self.hits / (self.objects + self.detections)


@dataclass(frozen=True, slots=True)
class AveragePrecision:
    """Average precision by the rules of COCO, 101 recall points; NaN where there is no object.

    Attributes:
        ap50: At an IoU of 0.50.
        ap75: At an IoU of 0.75.
        ap: Mean over IoUs of 0.50 to 0.95 in steps of 0.05.
        ar: Largest recall, mean over the same IoUs, of at most 100 detections.
    """

    ap50: float
    ap75: float
    ap: float
    ar: float


@dataclass(frozen=True, slots=True, eq=False)
class ClassScore:
    """The scores of one class.

    Attributes:
        label: The class.
        average: Its average precision.
        counts: At the operating threshold.
        best_score: Confidence threshold with the highest F1; NaN without detections or objects.
        best_f1: F1 there.
        precision_at_recall: (101,) float64 precision at recalls of 0 to 1, at an IoU of 0.50;
            NaN where there is no object.
    """

    label: str
    average: AveragePrecision
    counts: Counts
    best_score: float
    best_f1: float
    precision_at_recall: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImageMistakes:
    """What is wrong in one image at the operating threshold."""

    name: str
    objects: int
    missed: int
    false: int


@dataclass(frozen=True, slots=True, eq=False)
class BoxScores:
    """How well detections agree with labels.

    Attributes:
        iou: Overlap of the counts.
        score: Confidence threshold of the counts.
        images: Number of images that were compared.
        average: Mean of the classes that have objects.
        ap50_interval: 5 % and 95 % quantiles of the mean AP50 over images drawn anew with
            replacement (bootstrap); NaN where there are fewer than 10 images, or no object.
        counts: All classes together.
        classes: By class, in alphabetical order.
        by_size: By COCO's sizes of boxes (areas up to 32 and up to 96 pixels squared), the
            average precision and the counts.
        by_height: Counts by height of the box in pixels.
        by_range: Counts by distance, empty where the labels have none. Detections that are no
            object and have no distance of their own are in `unknown`; where no detection has
            one, they are None in the other bands.
        confusions: (class of the object, class of the detection, how often), most first.
        mistakes: False detections by kind.
        worst: The images with the most mistakes, most first.
        dropped: What was left out, by reason.
        notes: What a reader of the figures has to know.
        verdict: How far they can be trusted.
        why: Reasons for the verdict.
    """

    iou: float
    score: float
    images: int
    average: AveragePrecision
    ap50_interval: tuple[float, float]
    counts: Counts
    classes: tuple[ClassScore, ...]
    by_size: Mapping[str, tuple[AveragePrecision, Counts]]
    by_height: Mapping[str, Counts]
    by_range: Mapping[str, Counts]
    confusions: tuple[tuple[str, str, int], ...]
    mistakes: Mapping[str, int]
    worst: tuple[ImageMistakes, ...]
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    verdict: Verdict = Verdict.BAD
    why: tuple[str, ...] = ()
