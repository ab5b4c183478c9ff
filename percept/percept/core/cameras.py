"""Camera models: points in an optical frame to pixels and back.

Optical frames are z forward, x right, y down. Pixel (0, 0) is the centre of the top-left
pixel. Only the models that the rig file names are here; both follow OpenCV's coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["PinholeCamera"]

_UNDISTORT_ITERATIONS = 50
_NEAREST_DEPTH_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PinholeCamera:
    """A pinhole with radial and tangential distortion (Brown 1971, OpenCV's five coefficients).

    Attributes:
        image_size: (width, height) in pixels.
        K: (3, 3) float64 camera matrix, pixels, without skew.
        distortion: (5,) float64 k1, k2, p1, p2, k3.

    Raises:
        GeometryError: If a shape is wrong or a focal length is not positive.
    """

    image_size: tuple[int, int]
    K: NDArray[np.float64]
    distortion: NDArray[np.float64]

    def __post_init__(self) -> None:
        if np.shape(self.K) != (3, 3) or np.shape(self.distortion) != (5,):
            raise GeometryError(
                f"K is (3, 3) and distortion (5,), "
                f"not {np.shape(self.K)} and {np.shape(self.distortion)}"
            )
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise GeometryError("focal lengths must be positive")

    def project(
        self, points_cam: NDArray[np.floating]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Project points.

        Args:
            points_cam: (N, 3) in the optical frame, metres.

        Returns:
            Pixels (N, 2) u, v, and a mask (N,) of points in front of the camera whose pixel
            lies in the image. Pixels of other points are NaN behind the camera.
        """
        points = np.asarray(points_cam, dtype=np.float64)
        in_front = points[:, 2] > _NEAREST_DEPTH_M
        depth = np.where(in_front, points[:, 2], np.nan)
        normal = self._distort(points[:, :2] / depth[:, None])
        pixels = normal * [self.K[0, 0], self.K[1, 1]] + self.K[:2, 2]
        width, height = self.image_size
        with np.errstate(invalid="ignore"):
            inside = (pixels >= -0.5).all(axis=1) & (pixels < [width - 0.5, height - 0.5]).all(
                axis=1
            )
        return pixels, in_front & inside

    def unproject(self, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return unit rays (N, 3) in the optical frame of pixels (N, 2).

        The distortion is inverted by fixed-point iteration, which converges for the mild
        distortion of automotive lenses.
        """
        distorted = (np.asarray(pixels, dtype=np.float64) - self.K[:2, 2]) / [
            self.K[0, 0],
            self.K[1, 1],
        ]
        normal = distorted.copy()
        for _ in range(_UNDISTORT_ITERATIONS):
            normal = normal - (self._distort(normal) - distorted)
        rays = np.column_stack([normal, np.ones(len(normal))])
        unit: NDArray[np.float64] = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def _distort(self, normal: NDArray[np.float64]) -> NDArray[np.float64]:
        k1, k2, p1, p2, k3 = self.distortion
        x, y = normal[:, 0], normal[:, 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.column_stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ]
        )
