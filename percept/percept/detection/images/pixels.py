"""Pixels of any camera as 8-bit BGR, and those as the numbers of a network's input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.detection.networks.layout import PixelFormat
from percept.lidar.compiled import compiled

__all__ = ["PIXEL_FORMATS", "as_bgr8", "fill_planes", "name_of_pixels"]

PIXEL_FORMATS = {
    "rgb1": PixelFormat("rgb", 1 / 255),
    "bgr255": PixelFormat("bgr", 1.0),
    "rgb255": PixelFormat("rgb", 1.0),
    "bgr1": PixelFormat("bgr", 1 / 255),
}


def name_of_pixels(pixels: PixelFormat) -> str:
    """Return the name of a pixel format: `rgb1`, `bgr255`, `rgb255` or `bgr1`."""
    return pixels.order + ("255" if pixels.scale == 1.0 else "1")


def as_bgr8(pixels: NDArray[Any], white_level: float | None = None) -> NDArray[np.uint8]:
    """Return an image as (H, W, 3) uint8 BGR.

    Grey is repeated in the three channels. Other numbers than bytes have no white of their own
    (a 16-bit image may hold 10, 12 or 14 bits, temperatures, or millimetres of depth), and taken
    for pictures they would be dark ones in which nothing is found: the level must be said.

    Args:
        pixels: (H, W), (H, W, 1) or (H, W, 3) BGR; uint8, or with a white level any number.
        white_level: The value that becomes 255, such as 4095 for 12 bits; needed where the
            pixels are not uint8, and then only.

    Raises:
        GeometryError: If the shape is not that of a picture, or the white level is not known.
    """
    if not isinstance(pixels, np.ndarray):
        raise GeometryError(
            f"an image is an array, not {type(pixels).__name__}",
            remedy="cv2.imread gives None where it cannot read a file",
        )
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] not in (1, 3)):
        raise GeometryError(
            f"an image is (H, W) or (H, W, 3) in BGR, not {pixels.shape}",
            remedy="Bring it to BGR first, such as with cv2.cvtColor",
        )
    if pixels.size == 0:
        raise GeometryError(f"an image of {pixels.shape[1]} x {pixels.shape[0]} pixels is empty")
    if pixels.dtype != np.uint8:
        pixels = _to_bytes(pixels, white_level)
    if pixels.ndim == 3 and pixels.shape[2] == 3:
        return pixels
    return np.repeat(pixels.reshape(*pixels.shape[:2], 1), 3, axis=2)


def _to_bytes(pixels: NDArray[Any], white_level: float | None) -> NDArray[np.uint8]:
    if white_level is None:
        raise GeometryError(
            f"{pixels.dtype} pixels do not say which value is white",
            remedy="Set 'white_level', such as 4095 for a 12-bit camera; depth is no picture",
        )
    levels = np.clip(np.nan_to_num(pixels.astype(np.float32)), 0, white_level)
    scaled: NDArray[np.float32] = np.rint(levels * np.float32(255 / white_level))
    return scaled.astype(np.uint8)


@compiled
def fill_planes(
    planes: NDArray[Any], image: NDArray[np.uint8], levels: NDArray[Any], *, reverse: bool
) -> None:
    """Write an image into the planes of a tensor, through a table of what each byte becomes.

    Args:
        planes: (3, h, w), written; a part of the tensor.
        image: (h, w, 3) uint8.
        levels: (256,) what each byte becomes.
        reverse: Whether the last channel goes first.
    """
    for channel in range(3):
        source = 2 - channel if reverse else channel
        for row in range(image.shape[0]):
            for column in range(image.shape[1]):
                planes[channel, row, column] = levels[image[row, column, source]]
