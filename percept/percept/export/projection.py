"""Clouds in images: where the points of a scan appear, for views and pictures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform

__all__ = ["project_cloud"]


def project_cloud(
    points_cloud: NDArray[np.floating],
    T_camera_cloud: Transform,
    camera: Camera,
    *,
    most: int = 4_000,
) -> NDArray[np.float64]:
    """Return where the points of a cloud appear in an image.

    A vehicle that moves between the scan and the image shifts them; what stands before a point
    does not hide it.

    Args:
        points_cloud: (N, 3) metres, in the cloud's frame.
        T_camera_cloud: Maps them into the camera's optical frame.
        camera: The camera.
        most: Points that are returned at most. Of a large cloud only four times as many are looked
            at, evenly taken.

    Returns:
        (M, 3) u, v in pixels of the recorded image and the depth along the optical axis in metres.
    """
    step = max(1, math.ceil(len(points_cloud) / (4 * most)))
    points_cam = T_camera_cloud.apply(points_cloud[::step])
    pixels, seen = camera.project(points_cam)
    found = np.column_stack([pixels[seen], points_cam[seen, 2]])
    return found[:: max(1, math.ceil(len(found) / most))]
