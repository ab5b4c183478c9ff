"""Where the lines of a road meet: the vanishing point, from straight segments in the image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["VanishingPoint", "find_segments", "find_vanishing_point"]

_F64 = NDArray[np.float64]

_TURN_SD_RAD = np.radians(1.2)  # of a segment against the direction to the vanishing point
_SEED = 7
_PAIRS = 1500


@dataclass(frozen=True, slots=True, eq=False)
class VanishingPoint:
    """Where lines meet.

    Attributes:
        pixel: (2,) float64 u, v.
        length_px: Total length of the segments that go through it, and lie on both sides.
        sd_px: (2,) float64 spread.
    """

    pixel: _F64
    length_px: float
    sd_px: _F64


def find_segments(gray: NDArray[np.uint8], *, min_length_px: float) -> _F64:
    """Return straight segments (N, 4) u1, v1, u2, v2 of an image (H, W), each lower end first.

    The detector is LSD (Grompone von Gioi et al. 2010).
    """
    found: Any = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(gray)[0]
    if found is None:
        return np.zeros((0, 4))
    ends = np.asarray(found, dtype=np.float64).reshape(-1, 4)
    flip = ends[:, 1] < ends[:, 3]
    ends[flip] = ends[flip][:, [2, 3, 0, 1]]
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    # Across the image lie hoods, shadows of bridges and joints: they say nothing of the lane.
    steep = np.abs(ends[:, 3] - ends[:, 1]) > np.sin(np.radians(10)) * length
    kept: _F64 = ends[steep & (length >= min_length_px)]
    return kept


def find_vanishing_point(segments: _F64, expected_px: _F64, sd_px: _F64) -> VanishingPoint | None:
    """Find the point that most segments below it go through.

    Candidates are crossings of pairs; each is judged by the lengths of the segments whose
    direction agrees with it, on its left and on its right apart: one bundle alone fixes no point.

    Args:
        segments: (N, 4) float64 u1, v1, u2, v2.
        expected_px: (2,) where it is expected.
        sd_px: (2,) spread of that.

    Returns:
        The point, or None where segments do not meet in one.
    """
    middles = (segments[:, :2] + segments[:, 2:]) / 2
    along = segments[:, 2:] - segments[:, :2]
    length = np.hypot(*along.T)
    along = along / np.maximum(length, 1e-9)[:, None]
    candidates = _crossings(middles, along, length)
    near = np.abs(candidates - expected_px) < 3 * sd_px
    candidates = candidates[near.all(axis=1)]
    if not len(candidates):
        return None
    scores = _weights(candidates, middles, along, length)[0]
    scores = scores * np.exp(-0.5 * (((candidates - expected_px) / sd_px) ** 2).sum(axis=1))
    pixel = candidates[int(np.argmax(scores))]
    if scores.max() <= 0:
        return None
    covariance = np.diag(sd_px**2)
    for _ in range(5):
        weights = _weights(pixel[None], middles, along, length)[1][0]
        pixel, covariance = _meeting(middles, along, weights, expected_px, sd_px)
    scores, found = _weights(pixel[None], middles, along, length)
    if scores[0] <= 0:
        return None
    return VanishingPoint(pixel, float(found.sum()), np.sqrt(np.diag(covariance)))


def _crossings(middles: _F64, along: _F64, length: _F64) -> _F64:
    if len(middles) < 2:
        return np.zeros((0, 2))
    draw = np.random.default_rng(_SEED)
    i, j = draw.choice(len(middles), size=(2, _PAIRS), p=length / length.sum())
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    offset = (normal * middles).sum(axis=1)
    det = normal[i, 0] * normal[j, 1] - normal[i, 1] * normal[j, 0]
    apart = np.abs(det) > np.sin(np.radians(5))
    i, j, det = i[apart], j[apart], det[apart]
    u = (offset[i] * normal[j, 1] - offset[j] * normal[i, 1]) / det
    v = (normal[i, 0] * offset[j] - normal[j, 0] * offset[i]) / det
    return np.column_stack([u, v])


def _weights(points: _F64, middles: _F64, along: _F64, length: _F64) -> tuple[_F64, _F64]:
    """Return how well points are the meeting of segments (P,), and the segments' weights (P, N)."""
    u, v = ((points[:, k, None] - middles[:, k]) for k in range(2))
    distance = np.maximum(np.hypot(u, v), 1e-9)
    turn = (along[:, 0] * v - along[:, 1] * u) / distance
    weights = np.where(v < 0, length * np.exp(-0.5 * (turn / _TURN_SD_RAD) ** 2), 0.0)
    left = np.where(u > 0, weights, 0).sum(axis=1)
    return np.sqrt(left * (weights.sum(axis=1) - left).clip(0)), weights


def _meeting(
    middles: _F64, along: _F64, weights: _F64, expected_px: _F64, sd_px: _F64
) -> tuple[_F64, _F64]:
    """Return the weighted least-squares crossing and its covariance."""
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    offset = (normal * middles).sum(axis=1)
    # A direction is known to about a pixel over the length: far segments fix the point best, but
    # near ones are longer.
    information = (normal * weights[:, None]).T @ normal / 100.0 + np.diag(1e-2 / sd_px**2)
    target = (normal * (weights * offset)[:, None]).sum(
        axis=0
    ) / 100.0 + 1e-2 * expected_px / sd_px**2
    covariance = np.linalg.inv(information)
    return np.asarray(covariance @ target), np.asarray(covariance, dtype=np.float64)
