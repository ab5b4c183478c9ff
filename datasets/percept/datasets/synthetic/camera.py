"""The view that is drawn for a camera: without distortion, finer, and wide enough.

Straight edges stay straight without distortion, so triangles are drawn there, and the
distorted image is gathered from it afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import PinholeCamera
from percept.core.errors import GeometryError
from percept.datasets.synthetic.render_kernels import undistorted_lattice

__all__ = ["UndistortedView", "undistorted_view"]

_LARGEST_STRETCH = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class UndistortedView:
    """A grid of samples that covers what a distorted camera sees.

    Attributes:
        width: Samples in a row.
        height: Rows of samples.
        grid: fx, fy, cx, cy in samples; sample (0, 0) is the top-left one.
        lattice: (image height + 1, image width + 1, 2) float32, read-only: sample coordinates
            of the corners of the image's pixels.
    """

    width: int
    height: int
    grid: tuple[float, float, float, float]
    lattice: NDArray[np.float32]


def undistorted_view(camera: PinholeCamera, supersampling: int) -> UndistortedView:
    """Return the view for a camera with some samples along each side of a pixel.

    Without distortion the samples are exactly those that subdivide each pixel. Views of the
    last few cameras are kept.

    Raises:
        GeometryError: If the distortion cannot be undone over the whole image.
    """
    K, distortion = (np.asarray(a, dtype=np.float64) for a in (camera.K, camera.distortion))
    return _view(camera.image_size, K.tobytes(), distortion.tobytes(), supersampling)


@lru_cache(maxsize=8)
def _view(
    image_size: tuple[int, int], K_bytes: bytes, distortion_bytes: bytes, supersampling: int
) -> UndistortedView:
    K = np.frombuffer(K_bytes).reshape(3, 3)
    normal = undistorted_lattice(*image_size, K, np.frombuffer(distortion_bytes))
    pixels = normal * K[[0, 1], [0, 1]] + K[:2, 2]
    # One pixel more on every side, for the samples around the outermost ones.
    first = np.floor(pixels.min(axis=(0, 1))) - 1
    width, height = np.ceil(pixels.max(axis=(0, 1))) + 1 - first
    if not width * height <= _LARGEST_STRETCH * image_size[0] * image_size[1]:
        raise GeometryError(
            "the distortion has no inverse over the whole image, or one that stretches it "
            f"more than {_LARGEST_STRETCH:g} times",
            where=f"camera of {image_size[0]}x{image_size[1]} pixels",
            remedy="Use milder distortion coefficients or a narrower field of view",
        )
    # Sample i of the grid lies at the pixel first + (i + 0.5) / supersampling.
    lattice = ((pixels - first) * supersampling - 0.5).astype(np.float32)
    lattice.setflags(write=False)
    cx, cy = (K[:2, 2] - first) * supersampling - 0.5
    fx, fy = K[0, 0] * supersampling, K[1, 1] * supersampling
    grid = (float(fx), float(fy), float(cx), float(cy))
    return UndistortedView(int(width * supersampling), int(height * supersampling), grid, lattice)
