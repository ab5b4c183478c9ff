"""All boxes of all images as columns, which everything else is counted from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.labels import ANY_LABEL, LabelledImage
from percept.evaluation.boxes_2d.config import BoxScoreConfig
from percept.evaluation.boxes_2d.pairing import ImagePairs

__all__ = [
    "Compared",
    "DetectionTable",
    "Matches",
    "TruthTable",
    "detection_table",
    "truth_table",
]

_F64 = NDArray[np.float64]
_Int = NDArray[np.int64]
_Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class TruthTable:
    """T labelled boxes.

    Attributes:
        image: (T,) int64 place of the image.
        label: (T,) int64 place of the class.
        boxes_px: (T, 4) float64 x1, y1, x2, y2.
        range_m: (T,) float64; NaN where unknown.
        region: (T,) bool: the box is a region in which detections do not count.
        counted: (T,) bool: the box is an object that has to be found.
    """

    image: _Int
    label: _Int
    boxes_px: _F64
    range_m: _F64
    region: _Bool
    counted: _Bool


@dataclass(frozen=True, slots=True, eq=False)
class DetectionTable:
    """D detections; the columns of `TruthTable`, and `score` (D,) float64."""

    image: _Int
    label: _Int
    boxes_px: _F64
    range_m: _F64
    score: _F64

    def __len__(self) -> int:
        return len(self.score)


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """What each of D detections is at one overlap.

    Attributes:
        truth: (D,) int64 row of the object that the detection is, or -1.
        counted: (D,) bool: False for detections in regions, on objects that do not count, lower
            than what counts, and beyond the 100 best of their class in an image.
    """

    truth: _Int
    counted: _Bool


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """Labels and detections at one confidence threshold and one overlap.

    Attributes:
        truth: The labelled boxes.
        found: The detections.
        matches: Which detection is which object from the overlap on.
        score: Confidence from which a detection counts.
        iou: The overlap.
    """

    truth: TruthTable
    found: DetectionTable
    matches: Matches
    score: float
    iou: float

    @property
    def made(self) -> _Bool:
        """(D,) bool: the detections that count."""
        return self.matches.counted & (self.found.score >= self.score)

    @property
    def hit(self) -> _Bool:
        """(D,) bool: the detections that are an object, whether they count or not."""
        return self.matches.truth >= 0


def truth_table(pairs: ImagePairs, config: BoxScoreConfig) -> TruthTable:
    """Return the labelled boxes; a region of any class is there once for each class."""
    labelled = [image for image, _ in pairs.images]
    image, row, label = _rows(labelled, pairs.classes)
    boxes = _column([one.boxes_px for one in labelled], row).reshape(-1, 4)
    visible = _column([one.visible for one in labelled], row)
    region = _column([one.ignore for one in labelled], row).astype(bool)
    seen = np.isnan(visible) | (visible >= config.min_visible)
    tall = boxes[:, 3] - boxes[:, 1] >= config.min_height_px
    return TruthTable(
        image=image,
        label=label,
        boxes_px=boxes,
        range_m=_column([one.range_m for one in labelled], row),
        region=region,
        counted=~region & seen & tall,
    )


def detection_table(pairs: ImagePairs) -> DetectionTable:
    """Return the detections of the compared classes; without a confidence they have 1."""
    found = [image for _, image in pairs.images]
    image, row, label = _rows(found, pairs.classes)
    scores = [np.ones(len(one)) if one.confidences is None else one.confidences for one in found]
    return DetectionTable(
        image=image,
        label=label,
        boxes_px=_column([one.boxes_px for one in found], row).reshape(-1, 4),
        range_m=_column([one.range_m for one in found], row),
        score=_column(scores, row),
    )


def _rows(images: Sequence[LabelledImage], classes: Sequence[str]) -> tuple[_Int, _Int, _Int]:
    """Return place of the image, place among all boxes, and class of each box that is compared."""
    places = {name: (k,) for k, name in enumerate(classes)}
    everywhere = tuple(range(len(classes)))
    rows, first = [], 0
    for number, image in enumerate(images):
        for row, name in enumerate(image.labels, first):
            chosen = everywhere if name == ANY_LABEL else places.get(name, ())
            rows += [(number, row, label) for label in chosen]
        first += len(image)
    columns = np.array(rows, dtype=np.int64).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]


def _column(parts: Sequence[NDArray[Any]], row: _Int) -> NDArray[Any]:
    return np.concatenate(parts)[row] if parts else np.zeros(0)
