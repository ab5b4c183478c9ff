"""What a traffic light shows, from the picture inside its box.

For detectors that find lights and do not tell their state. The classifier is a linear one
(multinomial logistic regression) on the description of `crop_features`; `light_colours.md`
beside this file says what it was made from, how good it is, and what it is not for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.lights.crop_features import CONTRASTS, crop_features

__all__ = ["UNKNOWN", "classify_light_crops", "light_crops"]

UNKNOWN = "unknown"
"""Answer for a crop whose most probable state is not probable enough."""

# In 99 of 100 real crops, also at a height of 8 pixels, something stands out by 0.05 or more.
_LEAST_CONTRAST = 0.03
_MODEL = Path(__file__).with_name("light_colours.npz")


@dataclass(frozen=True, slots=True, eq=False)
class _Classifier:
    """What the file of the model holds, for S states.

    Attributes:
        states: Their names.
        weights: (S, F) float64 and
        bias: (S,) float64 of the logits.
        least: (S,) float64 probability from which a state is answered.
        most_red: Green is not answered of a crop that is red with more than this probability.
    """

    states: tuple[str, ...]
    weights: NDArray[np.float64]
    bias: NDArray[np.float64]
    least: NDArray[np.float64]
    most_red: float


def light_crops(image: NDArray[np.uint8], boxes_px: NDArray[np.float64]) -> list[NDArray[np.uint8]]:
    """Return the part of an image (H, W, 3) inside each box (N, 4) x1, y1, x2, y2.

    Pixels that a box covers in part belong to it. Of a box outside the image nothing is left.
    """
    height, width = image.shape[:2]
    crops = []
    for x1, y1, x2, y2 in boxes_px.tolist():
        top, bottom = max(int(np.floor(y1)), 0), min(int(np.ceil(y2)), height)
        left, right = max(int(np.floor(x1)), 0), min(int(np.ceil(x2)), width)
        crops.append(image[top : max(bottom, top), left : max(right, left)])
    return crops


def classify_light_crops(crops: Sequence[NDArray[np.uint8]]) -> list[tuple[str, float]]:
    """Say what the lights in some crops show.

    Args:
        crops: (H, W, 3) uint8 BGR each, the box of one light of whatever size.

    Returns:
        For each crop `red`, `yellow`, `green`, or `off` where no lamp shines, and the calibrated
        probability of it; `unknown` where the most probable one is not probable enough, with
        its probability, and with 0 for a crop without pixels or one in which nothing stands
        out, such as clear sky. Green asks for the most, and for next to no red.

    Raises:
        GeometryError: If a crop is no BGR picture of bytes.
    """
    for crop in crops:
        if crop.ndim != 3 or crop.shape[2] != 3 or crop.dtype != np.uint8:
            raise GeometryError(f"a crop is (H, W, 3) uint8, not {crop.shape} {crop.dtype}")
    return [_classified(crop, _classifier()) for crop in crops]


def _classified(crop: NDArray[np.uint8], classifier: _Classifier) -> tuple[str, float]:
    if not crop.size:
        return UNKNOWN, 0.0
    features = crop_features(crop)
    if features[CONTRASTS].max() < _LEAST_CONTRAST:
        return UNKNOWN, 0.0
    logits = classifier.weights @ features + classifier.bias
    chances = np.exp(logits - logits.max())
    chances /= chances.sum()
    best = int(chances.argmax())
    state, chance = classifier.states[best], float(chances[best])
    sure = chance >= classifier.least[best]
    if state == "green":
        sure &= chances[classifier.states.index("red")] <= classifier.most_red
    return state if sure else UNKNOWN, chance


@lru_cache(maxsize=1)
def _classifier() -> _Classifier:
    with np.load(_MODEL, allow_pickle=False) as stored:
        states = tuple(str(state) for state in stored["states"])
        weights, bias, least = (stored[name] for name in ("weights", "bias", "least"))
        return _Classifier(states, weights, bias, least, float(stored["most_red"]))
