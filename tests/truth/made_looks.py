"""Pictures of made-up streets and the looks of them, for tests of what is chosen for labels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.datasets.labelling.choice.image_look import ImageLook, look_at

__all__ = ["look_of_place", "picture_of_place"]


def picture_of_place(
    number: int, width: int = 640, height: int = 360, deviation: float = 0.0
) -> NDArray[np.uint8]:
    """Return (height, width, 3) uint8: rectangles of many sizes over a sky and a road.

    Args:
        number: Which place: another number gives another picture.
        width: Pixels.
        height: Pixels.
        deviation: Standard deviation of the sensor's noise, which is another in each call.
    """
    random = np.random.default_rng(number)
    picture = np.full((360, 640, 3), (170, 150, 140), np.uint8)
    picture[200:] = 90
    for _ in range(60):
        x, y = random.integers(0, 600), random.integers(60, 340)
        w, h = random.integers(8, 120), random.integers(8, 90)
        colour = tuple(int(c) for c in random.integers(20, 230, 3))
        cv2.rectangle(picture, (int(x), int(y)), (int(x + w), int(y + h)), colour, -1)
    scaled = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA))
    if not deviation:
        return scaled.astype(np.uint8)
    noise = np.random.default_rng().normal(0.0, deviation, scaled.shape)
    return np.clip(scaled + noise, 0, 255).astype(np.uint8)


def look_of_place(number: int, deviation: float = 0.0) -> ImageLook:
    """Return the look of a picture of a place."""
    return look_at(picture_of_place(number, deviation=deviation))
