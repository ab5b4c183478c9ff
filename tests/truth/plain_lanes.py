"""The plain lane finder that beginners write: what ours is compared with.

Thresholds of the saturation and of the gradient, a trapezoid that was picked by hand on images of
1280x720, histogram peaks, nine sliding windows, second-order polynomials: the pipeline of many
course solutions, with its usual constants.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["plain_lanes"]

_SIZE = (1280, 720)
_SOURCE = np.array([[580, 460], [710, 460], [1150, 720], [150, 720]], np.float32)
_TARGET = np.array([[200, 0], [1080, 0], [1080, 720], [200, 720]], np.float32)
_WINDOWS, _MARGIN, _LEAST = 9, 100, 50


def plain_lanes(image: NDArray[np.uint8]) -> list[NDArray[np.float64] | None]:
    """Return the pixels (K, 2) of the left and the right line, None where one is not found."""
    height, width = image.shape[:2]
    full = np.asarray(cv2.resize(image, _SIZE), dtype=np.uint8)
    mask = _mask(full)
    there = cv2.getPerspectiveTransform(_SOURCE, _TARGET)
    above = np.asarray(cv2.warpPerspective(mask, there, _SIZE), dtype=np.uint8)
    histogram = above[360:].sum(axis=0)
    starts = (int(histogram[:640].argmax()), 640 + int(histogram[640:].argmax()))
    lines = [_line(above, start) for start in starts]
    back = np.linalg.inv(there)
    scale = np.array([width / _SIZE[0], height / _SIZE[1]])
    return [
        None if line is None else cv2.perspectiveTransform(line[None], back)[0] * scale
        for line in lines
    ]


def _mask(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    hls = cv2.cvtColor(image, cv2.COLOR_BGR2HLS)
    gradient = np.abs(cv2.Sobel(hls[..., 1], cv2.CV_64F, 1, 0))
    scaled = 255 * gradient / max(gradient.max(), 1e-9)
    found = ((scaled >= 20) & (scaled <= 100)) | ((hls[..., 2] >= 170) & (hls[..., 2] <= 255))
    return np.asarray(found, dtype=np.uint8)


def _line(mask: NDArray[np.uint8], start: int) -> NDArray[np.float64] | None:
    v, u = np.nonzero(mask)
    middle, kept = start, []
    tall = mask.shape[0] // _WINDOWS
    for window in range(_WINDOWS):
        bottom = mask.shape[0] - window * tall
        inside = (v < bottom) & (v >= bottom - tall) & (np.abs(u - middle) < _MARGIN)
        kept.append(np.flatnonzero(inside))
        if inside.sum() > _LEAST:
            middle = int(u[inside].mean())
    chosen = np.concatenate(kept)
    if len(chosen) < 3:
        return None
    rows = np.arange(mask.shape[0] - 1, -1, -10.0)
    columns = np.polyval(np.polyfit(v[chosen], u[chosen], 2), rows)
    return np.column_stack([columns, rows])
