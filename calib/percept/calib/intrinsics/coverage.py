"""Which part of the image the boards covered, and from which tilts and distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Coverage", "measure_coverage", "tilts_deg"]

_F64 = NDArray[np.float64]

CELLS = (10, 8)
"""Columns and rows of the cells in which corners are counted."""

_ACROSS = 256  # pixels along the longer side of the picture in which boards are drawn


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """What the views that were used show.

    Attributes:
        share: Of the image, how much the hulls of the corners of the views cover together.
        corners: (rows, columns) int64 corners in each cell of the image.
        unseen: Share of the image beyond the outermost corners: left, right, top, bottom.
        tilts_deg: (V,) angle between the board's normal and the line of sight to its middle.
        distances_m: (V,) distance to the board's middle.
        facing_deg: Largest angle between the normals of two boards: how much they turned.
    """

    share: float
    corners: NDArray[np.int64]
    unseen: dict[str, float]
    tilts_deg: _F64
    distances_m: _F64
    facing_deg: float


def measure_coverage(
    image_size: tuple[int, int],
    corners_px: Sequence[_F64],
    R_camera_board: _F64,
    middles_cam: _F64,
) -> Coverage:
    """Count corners by cell of the image, and measure the poses.

    Args:
        image_size: (width, height) in pixels.
        corners_px: By view, the corners (N, 2) that were used; at least one view.
        R_camera_board: (V, 3, 3).
        middles_cam: (V, 3) the boards' middles in the camera's frame, metres.
    """
    width, height = image_size
    every = np.concatenate(list(corners_px))
    counts, _, _ = np.histogram2d(
        every[:, 1],
        every[:, 0],
        bins=CELLS[::-1],
        range=[[-0.5, height - 0.5], [-0.5, width - 0.5]],
    )
    low, high = every.min(axis=0), every.max(axis=0)
    unseen = {
        "left": low[0] / width,
        "right": (width - 1 - high[0]) / width,
        "top": low[1] / height,
        "bottom": (height - 1 - high[1]) / height,
    }
    normals = R_camera_board[:, :, 2]
    between = np.clip(normals @ normals.T, -1, 1)
    return Coverage(
        _covered(image_size, corners_px),
        counts.astype(np.int64),
        {side: float(np.clip(share, 0, 1)) for side, share in unseen.items()},
        tilts_deg(R_camera_board, middles_cam),
        np.linalg.norm(middles_cam, axis=1),
        float(np.degrees(np.arccos(between.min()))),
    )


def _covered(image_size: tuple[int, int], corners_px: Sequence[_F64]) -> float:
    """Return the share of an image that the hulls of the corners cover together."""
    shrink = _ACROSS / max(image_size)
    width, height = (max(round(side * shrink), 1) for side in image_size)
    covered = np.zeros((height, width), np.uint8)
    for corners in corners_px:
        hull = cv2.convexHull(np.rint(corners * shrink).astype(np.int32))
        cv2.fillConvexPoly(covered, hull, (1,))
    return float(covered.mean())


def tilts_deg(R_camera_board: _F64, middles_cam: _F64) -> _F64:
    """Return the angles (V,) between the boards' normals and the lines of sight to them, deg.

    Args:
        R_camera_board: (V, 3, 3).
        middles_cam: (V, 3) the boards' middles in the camera's frame.
    """
    along = np.abs((R_camera_board[:, :, 2] * middles_cam).sum(axis=1))
    tilts: _F64 = np.degrees(np.arccos(np.clip(along / np.linalg.norm(middles_cam, axis=1), 0, 1)))
    return tilts
