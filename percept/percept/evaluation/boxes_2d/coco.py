"""The rules of COCO, by the code that defines them (pycocotools).

AP is the mean of the interpolated precision at 101 recalls, of the mean over classes; detections
are matched greedily by confidence, at most 100 of a class in an image. Sizes are areas of boxes,
because a box is all that is known; COCO's own files give the areas of masks.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from percept.evaluation.boxes_2d.result import AveragePrecision
from percept.evaluation.boxes_2d.tables import DetectionTable, Matches, TruthTable

__all__ = ["MOST_DETECTIONS", "SIZES", "CocoResult", "run_coco"]

MOST_DETECTIONS = 100
"""Detections of a class in an image that count, the most confident ones."""

_LARGEST_AREA = 1e10
SIZES = {
    "small": (0.0, 32.0**2),
    "medium": (32.0**2, 96.0**2),
    "large": (96.0**2, _LARGEST_AREA),
}
"""COCO's sizes, as areas in square pixels."""

_IOUS = np.linspace(0.5, 0.95, 10)


class _Evaluation(COCOeval):  # type: ignore[misc] # pycocotools has no types
    """COCO's evaluation, with objects that do not count although they are no regions."""

    lowest_px = 0.0

    def _prepare(self) -> None:
        super()._prepare()  # sets `ignore` from `iscrowd` alone
        for labelled in self._gts.values():
            for one in labelled:
                one["ignore"] = one["ignore"] or one["uncounted"]

    def evaluateImg(self, *arguments: Any) -> Any:  # noqa: ANN401, N802 - their name and types
        result = super().evaluateImg(*arguments)
        if result is not None and self.lowest_px > 0:
            found = self.cocoDt.loadAnns(result["dtIds"])
            low = np.array([one["bbox"][3] < self.lowest_px for one in found], dtype=bool)
            result["dtIgnore"] |= (result["dtMatches"] == 0) & low
        return result


@dataclass(frozen=True, slots=True, eq=False)
class CocoResult:
    """What COCO's evaluation gives.

    Attributes:
        overall: Mean over the classes.
        by_class: In the order of the classes.
        by_size: Mean over the classes, by name of `SIZES`.
        precision_at_recall: (K, 101) float64 of K classes at an IoU of 0.50; NaN of no objects.
        at_half: Matches at an IoU of 0.50.
        at_iou: Matches at the IoU that was asked for.
    """

    overall: AveragePrecision
    by_class: tuple[AveragePrecision, ...]
    by_size: dict[str, AveragePrecision]
    precision_at_recall: NDArray[np.float64]
    at_half: Matches
    at_iou: Matches


def run_coco(
    truth: TruthTable,
    found: DetectionTable,
    *,
    images: int,
    classes: int,
    iou: float,
    lowest_px: float,
) -> CocoResult:
    """Evaluate detections.

    Args:
        truth: The labelled boxes.
        found: The detections.
        images: Number of images.
        classes: Number of classes.
        iou: Overlap of the matches to return, beside 0.50.
        lowest_px: Detections lower than this do not count, unless they are an object.
    """
    ious = np.union1d(_IOUS, [iou])
    with contextlib.redirect_stdout(io.StringIO()):  # it reports its progress there
        evaluation = _evaluation(truth, found, images, classes, ious, lowest_px)
    precision = evaluation.eval["precision"][:, :, :, :, 0]  # IoU, recall, class, size
    recall = evaluation.eval["recall"][:, :, :, 0]  # IoU, class, size
    averages = _Averages(precision, recall, np.isin(ious, _IOUS), ious)
    half, asked = _nearest(ious, 0.5), _nearest(ious, iou)
    curves = np.asarray(precision[half, :, :, 0].T, dtype=np.float64)
    return CocoResult(
        overall=averages.of(),
        by_class=tuple(averages.of(label=label) for label in range(classes)),
        by_size={name: averages.of(size=place) for place, name in enumerate(SIZES, 1)},
        precision_at_recall=np.where(curves < 0, np.nan, curves),
        at_half=_matches(evaluation, half, images, classes, len(found)),
        at_iou=_matches(evaluation, asked, images, classes, len(found)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Averages:
    """Means of COCO's arrays; -1 in them is no object."""

    precision: NDArray[np.float64]
    recall: NDArray[np.float64]
    standard: NDArray[np.bool_]
    ious: NDArray[np.float64]

    def of(self, label: int | None = None, size: int = 0) -> AveragePrecision:
        labels = slice(None) if label is None else slice(label, label + 1)
        precision = self.precision[:, :, labels, size]
        return AveragePrecision(
            ap50=_mean(precision[_nearest(self.ious, 0.5)]),
            ap75=_mean(precision[_nearest(self.ious, 0.75)]),
            ap=_mean(precision[self.standard]),
            ar=_mean(self.recall[self.standard][:, labels, size]),
        )


def _nearest(ious: NDArray[np.float64], iou: float) -> int:
    return int(np.argmin(np.abs(ious - iou)))


def _mean(values: NDArray[np.float64]) -> float:
    known = values[values > -1]
    return float(known.mean()) if known.size else float("nan")


def _evaluation(
    truth: TruthTable,
    found: DetectionTable,
    images: int,
    classes: int,
    ious: NDArray[np.float64],
    lowest_px: float,
) -> _Evaluation:
    marks = [
        {"iscrowd": int(region), "uncounted": not counted}
        for region, counted in zip(truth.region, truth.counted, strict=True)
    ]
    scores = [{"score": float(score)} for score in found.score]
    evaluation = _Evaluation(
        _as_coco(truth, marks, images, classes), _as_coco(found, scores, images, classes), "bbox"
    )
    evaluation.lowest_px = lowest_px
    evaluation.params.iouThrs = ious
    evaluation.params.maxDets = [MOST_DETECTIONS]
    evaluation.params.areaRng = [[0.0, _LARGEST_AREA], *map(list, SIZES.values())]
    evaluation.params.areaRngLbl = ["all", *SIZES]
    evaluation.evaluate()
    evaluation.accumulate()
    return evaluation


def _as_coco(
    table: TruthTable | DetectionTable, more: list[dict[str, Any]], images: int, classes: int
) -> COCO:
    """Return a table as COCO's annotations; ids start at 1, since 0 is 'no match' to it."""
    sizes = table.boxes_px[:, 2:] - table.boxes_px[:, :2]
    boxes = np.column_stack([table.boxes_px[:, :2], sizes])
    coco = COCO()
    coco.dataset = {
        "images": [{"id": k + 1} for k in range(images)],
        "categories": [{"id": k + 1, "name": str(k)} for k in range(classes)],
        "annotations": [
            {
                "id": row + 1,
                "image_id": int(table.image[row]) + 1,
                "category_id": int(table.label[row]) + 1,
                "bbox": boxes[row].tolist(),
                "area": float(boxes[row, 2] * boxes[row, 3]),
                **extra,
            }
            for row, extra in enumerate(more)
        ],
    }
    coco.createIndex()
    return coco


def _matches(
    evaluation: _Evaluation, at: int, images: int, classes: int, detections: int
) -> Matches:
    """Read what each detection was matched with, from the part of all sizes."""
    truth = np.full(detections, -1, dtype=np.int64)
    counted = np.zeros(detections, dtype=bool)
    sizes = 1 + len(SIZES)
    for label in range(classes):
        first = label * sizes * images
        for result in evaluation.evalImgs[first : first + images]:
            if result is None:
                continue
            rows = np.array(result["dtIds"], dtype=np.int64) - 1
            counted[rows] = ~np.asarray(result["dtIgnore"][at], dtype=bool)
            truth[rows] = np.asarray(result["dtMatches"][at], dtype=np.int64) - 1
    truth[~counted] = -1
    return Matches(truth, counted)
