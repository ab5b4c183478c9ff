"""3D boxes in an image: the rectangle of each, how much of it the image cuts off, what hides it.

The edges of a box are cut off in front of the camera and bent by the lens. How much of the box is
outside the image, or behind another one, is the share of points spread over the faces that the
camera looks at.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from percept.core.box_edges import project_edges
from percept.core.cameras import Camera
from percept.core.sight_lines import is_hidden
from percept.core.transform import Transform

__all__ = ["ProjectedSolids", "project_solids"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

_SAMPLES_PER_EDGE = 9  # distortion bends the edges of a box, so its corners are not enough
_SAMPLES_PER_FACE = 6  # along each side
# Of length, width and height: what stands in a box is rounder and slimmer than the box.
_FILLED = (0.8, 0.8, 0.9)
_EDGE_OF_IMAGE_PX = 0.5  # pixels count from the centre of the first one, boxes from its edge


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ProjectedSolids:
    """3D boxes as rectangles in an image.

    Attributes:
        boxes_px: (N, 4) float64 x1, y1, x2, y2, counted from the outer edge of the top left
            pixel as all 2D boxes are, and cut off at the border of the image; without area where
            nothing of the box is in it.
        depths_m: (N,) float64 depth of the centres along the optical axis.
        truncated: (N,) float64 share of what faces the camera that is outside the image, 0..1.
        occluded: (N,) float64 share of what is in the image that other boxes hide, 0..1; NaN of
            boxes of which nothing is in it.
    """

    boxes_px: _F64
    depths_m: _F64
    truncated: _F64
    occluded: _F64

    def sizes_px(self) -> _F64:
        """Return (N, 2) widths and heights."""
        sizes: _F64 = self.boxes_px[:, 2:] - self.boxes_px[:, :2]
        return sizes


def project_solids(
    boxes_m: _F64,
    T_camera_boxes: Transform,
    camera: Camera,
    hiding: NDArray[np.bool_] | None = None,
) -> ProjectedSolids:
    """Return where boxes appear in an image, and how much of them.

    A box that reaches out of the image reaches its border; one around the camera itself appears
    nowhere.

    Args:
        boxes_m: (N, 7) boxes as in `Detections3D`, where they are when the image is taken.
        T_camera_boxes: Maps the frame of the boxes into the optical frame.
        camera: The lens.
        hiding: (N,) which of them can hide others; None means all.
    """
    count = len(boxes_m)
    eye = T_camera_boxes.inverse().translation_m
    boxes_px = _rectangles(boxes_m, T_camera_boxes, camera)
    near = np.flatnonzero((boxes_px[:, 2:] > boxes_px[:, :2]).all(axis=1))
    points, weights, owners = _facing_points(boxes_m[near], eye)
    _, seen = camera.project(T_camera_boxes.apply(points))
    owners = near[owners]
    truncated = 1.0 - _shares(seen, weights, owners, count)
    boxes_px[truncated == 1.0] = 0.0
    others = np.arange(count) if hiding is None else np.flatnonzero(hiding)
    occluded = _occluded(boxes_m, others, eye, (points[seen], weights[seen], owners[seen]))
    return ProjectedSolids(
        boxes_px=boxes_px,
        depths_m=T_camera_boxes.apply(boxes_m[:, :3])[:, 2],
        truncated=truncated,
        occluded=occluded,
    )


def _occluded(boxes_m: _F64, hiding: _I64, eye: _F64, seen: tuple[_F64, _F64, _I64]) -> _F64:
    """Return (N,) which share of the points that are in the image other boxes hide."""
    points, weights, owners = seen
    filled = boxes_m * np.array([1, 1, 1, *_FILLED, 1])
    hidden = np.zeros(len(points), bool)
    shares = np.full(len(boxes_m), np.nan)
    for owner in np.unique(owners):
        rows = owners == owner
        hidden[rows] = is_hidden(eye, points[rows], filled[hiding[hiding != owner]])
        shares[owner] = weights[rows & hidden].sum() / weights[rows].sum()
    return shares


def _shares(chosen: NDArray[np.bool_], weights: _F64, owners: _I64, count: int) -> _F64:
    """Return (N,) the share of the weights of each box that is chosen; 0 of boxes without any."""
    whole = np.bincount(owners, weights, count)
    part = np.bincount(owners, weights * chosen, count)
    shares: _F64 = np.divide(part, whole, out=np.zeros(count), where=whole > 0)
    return shares


def _facing_points(boxes_m: _F64, eye: _F64) -> tuple[_F64, _F64, _I64]:
    """Return points (P, 3) on the faces that an eye looks at, weights (P,), and their boxes (P,).

    The weight is the solid angle that a point stands for.
    """
    half = np.maximum(boxes_m[:, 3:6] / 2, 1e-3)
    local_eye = _turned(eye - boxes_m[:, :3], -boxes_m[:, 6])
    steps = (np.arange(_SAMPLES_PER_FACE) + 0.5) / _SAMPLES_PER_FACE * 2 - 1
    grid = np.array(list(product(steps, repeat=2)))
    parts = []
    for axis in range(3):
        owners = np.flatnonzero(np.abs(local_eye[:, axis]) > half[:, axis])
        side = np.sign(local_eye[owners, axis])
        unit = np.insert(grid, axis, 1.0, axis=1)[None] * np.ones((len(owners), 1, 1))
        unit[:, :, axis] = side[:, None]
        local = unit * half[owners, None]
        ways = local - local_eye[owners, None]
        distances = np.linalg.norm(ways, axis=2)
        area = np.delete(half[owners], axis, axis=1).prod(axis=1) * 4 / len(grid)
        weights = area[:, None] * np.abs(ways[:, :, axis]) / distances**3
        placed = _turned(local, boxes_m[owners, None, 6]) + boxes_m[owners, None, :3]
        parts.append((placed.reshape(-1, 3), weights.ravel(), np.repeat(owners, len(grid))))
    points, weights, owners = (np.concatenate(column) for column in zip(*parts, strict=True))
    return points, weights, owners


def _turned(points: _F64, angles: _F64) -> _F64:
    """Return points (..., 3) turned about z by angles (...)."""
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = points[..., 0], points[..., 1]
    turned: _F64 = np.stack([cos * x - sin * y, sin * x + cos * y, points[..., 2]], axis=-1)
    return turned


def _rectangles(boxes_m: _F64, T_camera_boxes: Transform, camera: Camera) -> _F64:
    """Return (N, 4) rectangles in the image about the edges of boxes."""
    pixels, kept = project_edges(boxes_m, T_camera_boxes, camera, _SAMPLES_PER_EDGE)
    pixels += _EDGE_OF_IMAGE_PX
    low = np.where(kept[:, :, None], pixels, np.inf).min(axis=1, initial=np.inf)
    high = np.where(kept[:, :, None], pixels, -np.inf).max(axis=1, initial=-np.inf)
    border = np.array(camera.image_size, dtype=np.float64)
    boxes: _F64 = np.hstack([np.clip(low, 0, border), np.clip(high, 0, border)])
    boxes[~kept.any(axis=1)] = 0.0
    return boxes
