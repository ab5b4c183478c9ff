"""How far AP50 would be another with other images of the same kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.boxes_2d.tables import DetectionTable, Matches, TruthTable

__all__ = ["ap50_interval", "class_ap"]

_DRAWS = 200
_FEWEST_IMAGES = 10  # a draw of fewer is hardly ever another set of images
_QUANTILES = (0.05, 0.95)
_RECALLS = np.linspace(0.0, 1.0, 101)
_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Ranking:
    """The detections of a class, the most confident first, and its objects by image."""

    image: NDArray[np.int64]
    hit: NDArray[np.bool_]
    objects: _F64


def ap50_interval(
    truth: TruthTable, found: DetectionTable, at_half: Matches, *, images: int, classes: int
) -> tuple[float, float]:
    """Return the 5 % and 95 % quantiles of the mean AP50 over images drawn with replacement.

    Args:
        truth: The labelled boxes.
        found: The detections.
        at_half: Their matches at an IoU of 0.50.
        images: Number of images.
        classes: Number of classes.

    Returns:
        The quantiles of Efron's percentile bootstrap (1979, The Annals of Statistics 7(1)), with
        a fixed seed; NaN where no object counts, or of fewer than 10 images.
    """
    rankings = [_ranking(truth, found, at_half, label, images) for label in range(classes)]
    rankings = [ranking for ranking in rankings if ranking.objects.any()]
    if not rankings or images < _FEWEST_IMAGES:
        return float("nan"), float("nan")
    rng = np.random.default_rng(0)
    draws = rng.multinomial(images, np.full(images, 1 / images), size=_DRAWS).astype(np.float64)
    means = np.array([_mean_ap(rankings, weights) for weights in draws])
    low, high = np.nanquantile(means, _QUANTILES)
    return float(low), float(high)


def class_ap(image_weights: _F64, image: NDArray[np.int64], hit: _F64, objects: float) -> float:
    """Return the average precision at 101 recalls of ranked detections.

    Args:
        image_weights: (I,) how often each image counts.
        image: (D,) place of the image of each detection, the most confident first.
        hit: (D,) 1 where the detection is an object, else 0.
        objects: How many objects there are, counted as the images are.
    """
    weight = image_weights[image]
    hits, made = np.cumsum(weight * hit), np.cumsum(weight)
    precision = hits / np.maximum(made, np.spacing(1))
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    places = np.searchsorted(hits / objects, _RECALLS, side="left")
    return float(np.append(envelope, 0.0)[places].mean())


def _mean_ap(rankings: Sequence[_Ranking], weights: _F64) -> float:
    values = [
        class_ap(weights, one.image, one.hit.astype(np.float64), float(weights @ one.objects))
        for one in rankings
        if weights @ one.objects > 0
    ]
    return float(np.mean(values)) if values else float("nan")


def _ranking(
    truth: TruthTable, found: DetectionTable, matches: Matches, label: int, images: int
) -> _Ranking:
    rows = np.flatnonzero((found.label == label) & matches.counted)
    rows = rows[np.argsort(-found.score[rows], kind="stable")]
    wanted = truth.image[(truth.label == label) & truth.counted]
    objects = np.bincount(wanted, minlength=images).astype(np.float64)
    return _Ranking(found.image[rows], matches.truth[rows] >= 0, objects)
