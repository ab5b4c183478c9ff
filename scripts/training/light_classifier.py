"""The classifier of light crops: examples, fit, and honest splits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.lights.crop_features import crop_features
from training.light_crops import STATES, Crop, varied, with_lamp_out, with_unlit_lenses

__all__ = ["Classifier", "Predictions", "Views", "cross_validated", "fit", "splits", "test_views"]

_COPIES = {"red": 4, "yellow": 60, "green": 6}
_OFF_COPIES = {"red": 2, "yellow": 20, "green": 2}
_REGULARISATION = 1.0
_HEIGHTS_PX = (6, 8, 12)

Views = dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]
Predictions = dict[str, tuple[NDArray[np.float64], NDArray[np.int64]]]


@dataclass(frozen=True)
class Classifier:
    """Multinomial logistic regression: weights (S, F) and bias (S,)."""

    weights: NDArray[np.float64]
    bias: NDArray[np.float64]

    def chances(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return probabilities (N, S) of descriptions (N, F)."""
        return softmax(features @ self.weights.T + self.bias)


def softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return probabilities (N, S) of logits (N, S)."""
    raised: NDArray[np.float64] = np.exp(logits - logits.max(axis=1, keepdims=True))
    return raised / raised.sum(axis=1, keepdims=True)


def fit(crops: list[Crop], classes: NDArray[np.int64], seed: int) -> Classifier:
    """Learn from crops and their classes, as they are and varied, and from heads put out."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.preprocessing import StandardScaler

    rng = np.random.default_rng(seed)
    features, labels = zip(*_examples(crops, classes, rng), strict=True)
    scaler = StandardScaler().fit(features)
    model = LogisticRegression(C=_REGULARISATION, max_iter=2000)
    model.fit(scaler.transform(features), labels)
    weights = model.coef_ / scaler.scale_
    return Classifier(weights, model.intercept_ - weights @ scaler.mean_)


def _examples(
    crops: list[Crop], classes: NDArray[np.int64], rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.float64], int]]:
    for crop, number in zip(crops, classes.tolist(), strict=True):
        state = STATES[number]
        yield crop_features(crop), number
        for _ in range(_COPIES[state]):
            yield crop_features(varied(crop, rng)), number
        dark = with_lamp_out(crop, number)
        for _ in range(0 if dark is None else _OFF_COPIES[state]):
            unlit = with_unlit_lenses(dark, rng) if rng.random() < 0.5 else dark
            yield crop_features(varied(unlit, rng)), STATES.index("off")


def test_views(crops: list[Crop], classes: NDArray[np.int64], seed: int) -> Views:
    """Return descriptions (N, F) and classes (N,) of crops in several conditions.

    The row of a crop is the same in all of them. A class of -1 is to be left out.
    """
    rng = np.random.default_rng(seed)
    dark = [with_lamp_out(crop, number) for crop, number in zip(crops, classes, strict=True)]
    off = np.array([-1 if crop is None else STATES.index("off") for crop in dark])
    unlit = [crop if out is None else out for crop, out in zip(crops, dark, strict=True)]
    pictures = {"as they are": (crops, classes)}
    pictures |= {f"{px} px high": ([_at(c, px) for c in crops], classes) for px in _HEIGHTS_PX}
    pictures["varied"] = [varied(crop, rng) for crop in crops], classes
    pictures["put out"] = unlit, off
    return {
        name: (np.array([crop_features(c) for c in chosen]), labels)
        for name, (chosen, labels) in pictures.items()
    }


def _at(crop: Crop, height_px: int) -> Crop:
    width = max(round(crop.shape[1] * height_px / crop.shape[0]), 2)
    return cv2.resize(crop, (width, height_px), interpolation=cv2.INTER_AREA)


def splits(
    classes: NDArray[np.int64], groups: NDArray[np.int64] | None, seed: int
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return five (rows to learn from, rows to test on); groups are not torn apart."""
    from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold

    rows = np.zeros((len(classes), 1))
    if groups is None:
        return list(StratifiedKFold(5, shuffle=True, random_state=seed).split(rows, classes))
    folds = StratifiedGroupKFold(5, shuffle=True, random_state=seed)
    return list(folds.split(rows, classes, groups))


def cross_validated(
    crops: list[Crop],
    classes: NDArray[np.int64],
    views: Views,
    folds: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
    seed: int,
) -> Predictions:
    """Return probabilities (N, S) and classes (N,) in each condition, of the fold left out."""
    chances = {name: np.zeros((len(crops), len(STATES))) for name in views}
    for learn, test in folds:
        classifier = fit([crops[row] for row in learn], classes[learn], seed)
        for name, (features, _) in views.items():
            chances[name][test] = classifier.chances(features[test])
    return {name: (chances[name], labels) for name, (_, labels) in views.items()}
