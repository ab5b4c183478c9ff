"""Images without lens distortion, and boxes found in them back in the recorded image.

Networks are trained on ordinary photographs, in which edges are straight; a wide lens bends them.
Boxes count from the outer edge of the top left pixel.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera, PinholeCamera
from percept.core.errors import GeometryError

__all__ = ["Undistorter"]

_F64 = NDArray[np.float64]

_PAD = 114
_EDGE_SAMPLES = 17
_BORDER_SAMPLES = 65
# Towards a wide lens's corners a pinhole needs ever more pixels. Far objects in the middle are not
# made smaller than this for them; what does not fit is left out and told by `seen_share`.
_SMALLEST_SCALE = 0.7


class Undistorter:
    """Undistorts the images of one camera. One object serves many threads.

    The undistorted image has the size of the recorded one. Its focal lengths are those of the
    camera, made smaller until all that was recorded fits in, but not below 0.7 of them.

    Args:
        camera: The camera that recorded the images.

    Attributes:
        camera: The camera that recorded the images.
        undistorted: The pinhole without distortion that the undistorted images are of.
        seen_share: Share of the recorded pixels that the undistorted image shows.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        K = camera.K.copy()
        K[[0, 1], [0, 1]] *= _scale_that_fits(camera)
        self.undistorted = PinholeCamera(camera.image_size, K, np.zeros(5))
        self._maps = self._make_maps()
        self.seen_share = self._seen_share()

    def image(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Return an image without distortion; what was not recorded is grey.

        Args:
            pixels: (H, W) or (H, W, 3) as recorded.

        Raises:
            GeometryError: If the image has not the size that the camera was calibrated for.
        """
        width, height = self.camera.image_size
        if pixels.shape[:2] != (height, width):
            raise GeometryError(
                f"an image of {pixels.shape[1]} x {pixels.shape[0]} pixels cannot be undistorted "
                f"with intrinsics for {width} x {height}"
            )
        undistorted: NDArray[Any] = cv2.remap(
            pixels,
            *self._maps,
            interpolation=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(_PAD, _PAD, _PAD),
        )
        return undistorted

    def to_recorded(self, boxes_px: _F64) -> _F64:
        """Return boxes of the undistorted image in the recorded one.

        Straight edges become curves there; the result is the rectangle around them, within the
        image.

        Args:
            boxes_px: (N, 4) x1, y1, x2, y2 in the undistorted image.

        Returns:
            (N, 4); NaN for a box in which nothing recorded appears.
        """
        along = np.linspace(0, 1, _EDGE_SAMPLES)
        ends = np.zeros_like(along)
        sides = [(along, ends), (along, ends + 1), (ends, along), (ends + 1, along)]
        outline = np.concatenate([np.column_stack(side) for side in sides])
        corners = np.asarray(boxes_px, dtype=np.float64).reshape(-1, 1, 4)
        samples = corners[..., :2] + outline * (corners[..., 2:] - corners[..., :2])
        recorded = self.points_to_recorded(samples.reshape(-1, 2)).reshape(samples.shape)
        known = np.isfinite(recorded)
        low = np.where(known, recorded, np.inf).min(axis=1, initial=np.inf)
        high = np.where(known, recorded, -np.inf).max(axis=1, initial=-np.inf)
        size = np.array(self.camera.image_size, dtype=np.float64)
        boxes = np.concatenate([np.clip(low, 0, size), np.clip(high, 0, size)], axis=1)
        boxes[(boxes[:, 2:] <= boxes[:, :2]).any(axis=1)] = np.nan
        return boxes

    def points_to_recorded(self, points_px: _F64) -> _F64:
        """Return points (N, 2) of the undistorted image in the recorded one.

        Points beyond the angle up to which the lens model is one-to-one are NaN.
        """
        rays = self._rays(points_px - 0.5)
        pixels, _ = self.camera.project(rays)
        slopes = np.hypot(rays[:, 0], rays[:, 1])
        pixels[slopes > np.tan(self.camera.widest_rad)] = np.nan
        return pixels + 0.5

    def _rays(self, centres_px: _F64) -> _F64:
        K = self.undistorted.K
        normal = (centres_px - K[:2, 2]) / [K[0, 0], K[1, 1]]
        return np.column_stack([normal, np.ones(len(normal))])

    def _make_maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        width, height = self.camera.image_size
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        rays = self._rays(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
        pixels, seen = self.camera.project(rays)
        pixels[~seen] = -10.0
        at_u, at_v = pixels.astype(np.float32).T.reshape(2, height, width)
        fixed, weights = cv2.convertMaps(at_u, at_v, cv2.CV_16SC2)
        return np.asarray(fixed), np.asarray(weights)

    def _seen_share(self) -> float:
        width, height = self.camera.image_size
        u, v = np.meshgrid(
            np.linspace(0, width - 1, _BORDER_SAMPLES), np.linspace(0, height - 1, _BORDER_SAMPLES)
        )
        rays = self.camera.unproject(np.column_stack([u.ravel(), v.ravel()]))
        with np.errstate(invalid="ignore"):
            _, seen = self.undistorted.project(rays)
        return float(seen.mean())


def _scale_that_fits(camera: Camera) -> float:
    """Return the factor on the focal lengths at which the whole recorded image fits in."""
    width, height = camera.image_size
    u, v = np.linspace(0, width - 1, _BORDER_SAMPLES), np.linspace(0, height - 1, _BORDER_SAMPLES)
    sides = [np.column_stack([u, np.full_like(u, end)]) for end in (v[0], v[-1])]
    sides += [np.column_stack([np.full_like(v, end), v]) for end in (u[0], u[-1])]
    rays = camera.unproject(np.concatenate(sides))
    if not np.isfinite(rays).all():
        return _SMALLEST_SCALE
    reach = rays[:, :2] / rays[:, 2:] * [camera.K[0, 0], camera.K[1, 1]]
    centre = camera.K[:2, 2]
    room = np.where(reach > 0, np.array([width - 1, height - 1]) - centre, centre)
    ratio = np.abs(reach) / np.maximum(room, 1e-9)
    return float(np.clip(1 / ratio.max(), _SMALLEST_SCALE, 1.0))
