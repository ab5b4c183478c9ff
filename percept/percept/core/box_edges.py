"""The edges of 3D boxes as a camera shows them: cut off before it and bent by the lens."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform

__all__ = ["NEAR_PLANE_M", "box_corners", "project_edges"]

_F64 = NDArray[np.float64]

NEAR_PLANE_M = 0.1
"""What is nearer to the camera's plane than this is cut off."""

_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_EDGES = np.array(
    [(a, b) for a in range(8) for b in range(a) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1]
)


def box_corners(boxes_m: _F64) -> _F64:
    """Return the corners (N, 8, 3) of boxes (N, 7), in their frame."""
    local = _CORNERS * boxes_m[:, None, 3:6]
    cos, sin = np.cos(boxes_m[:, 6:7]), np.sin(boxes_m[:, 6:7])
    x = cos * local[..., 0] - sin * local[..., 1]
    y = sin * local[..., 0] + cos * local[..., 1]
    corners: _F64 = boxes_m[:, None, :3] + np.stack([x, y, local[..., 2]], axis=2)
    return corners


def project_edges(
    boxes_m: _F64, T_camera_boxes: Transform, camera: Camera, samples: int
) -> tuple[_F64, NDArray[np.bool_]]:
    """Return where points on the edges of boxes appear in an image.

    Edges are cut off in front of the camera. Points beyond the angle up to which the lens model
    is one-to-one count as seen at that angle, in their direction, so that a box that reaches out
    of the image still reaches its border.

    Args:
        boxes_m: (N, 7) boxes as in `Detections3D`.
        T_camera_boxes: Maps their frame into the optical frame.
        camera: The lens.
        samples: Points on each edge: distortion bends edges, so corners are not enough.

    Returns:
        Pixels (N, S, 2), not bounded by the image and NaN behind the camera, and (N, S) which
        points are before it.
    """
    corners = T_camera_boxes.apply(box_corners(boxes_m).reshape(-1, 3)).reshape(-1, 8, 3)
    points, kept = _sample_edges(corners, samples)
    pixels = np.full((*points.shape[:2], 2), np.nan)
    pixels[kept] = _project(points[kept], camera)
    return pixels, kept


def _sample_edges(corners: _F64, samples: int) -> tuple[_F64, NDArray[np.bool_]]:
    """Return (N, S, 3) points on the edges in front of the near plane, and which there are."""
    start, end = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    ahead = np.stack([start[..., 2], end[..., 2]], axis=2) - NEAR_PLANE_M
    rise = ahead[..., 1] - ahead[..., 0]
    crossing = -ahead[..., 0] / np.where(rise == 0, 1.0, rise)
    low = np.where(ahead[..., 0] < 0, crossing, 0.0)
    high = np.where(ahead[..., 1] < 0, crossing, 1.0)
    shares = low[..., None] + np.linspace(0, 1, samples) * (high - low)[..., None]
    points = start[:, :, None] + shares[..., None] * (end - start)[:, :, None]
    kept = np.broadcast_to(ahead.max(axis=2)[..., None] > 0, shares.shape)
    return points.reshape(-1, len(_EDGES) * samples, 3), kept.reshape(-1, len(_EDGES) * samples)


def _project(points_cam: _F64, camera: Camera) -> _F64:
    radius = np.hypot(points_cam[:, 0], points_cam[:, 1])
    widest = np.tan(camera.widest_rad) * points_cam[:, 2]
    inward = np.minimum(1.0, widest / np.maximum(radius, 1e-12))
    pixels, _ = camera.project(points_cam * np.column_stack([inward, inward, np.ones_like(inward)]))
    return pixels
