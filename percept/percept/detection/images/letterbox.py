"""How an image is brought to the size of a network's input, and boxes back to the image.

Boxes are counted from the outer edge of the top left pixel, as detectors and COCO do: a box that
holds the whole image is (0, 0, width, height). The centre of pixel (0, 0), where the geometry of
percept counts from, is (0.5, 0.5) here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.detection.images.pixels import fill_planes
from percept.detection.networks.layout import PixelFormat

__all__ = ["Fit", "Letterbox"]

Fit = Literal["centre", "corner", "stretch"]


@dataclass(frozen=True, slots=True)
class Letterbox:
    """The plan of one image size; `Letterbox.plan` makes it.

    Attributes:
        image_size: (width, height) of the image, pixels.
        input_size: (width, height) of the network's input, pixels.
        resized: (width, height) of the image inside the input, pixels.
        offset: (left, top) of the image inside the input, pixels.
        gain: (x, y) input pixels an image pixel.
        pad: Grey level around the image.
    """

    image_size: tuple[int, int]
    input_size: tuple[int, int]
    resized: tuple[int, int]
    offset: tuple[int, int]
    gain: tuple[float, float]
    pad: int = 114

    @classmethod
    def plan(
        cls,
        image_size: tuple[int, int],
        input_size: tuple[int, int],
        fit: Fit = "centre",
        pad: int = 114,
    ) -> Letterbox:
        """Plan as the networks of each kind were trained.

        `centre` is ultralytics' LetterBox and `scale_boxes`: sizes rounded, and the rounded size
        of each axis is its gain, so that the way back is exact. `corner` is YOLOX's `preproc`:
        sizes cut off, and one ratio for both axes in its training labels and its demo alike; what
        is drawn lies up to one input pixel nearer to the origin than the ratio says, and the
        network has learnt that along.

        Args:
            image_size: (width, height), pixels.
            input_size: (width, height), pixels.
            fit: As in `Layout`.
            pad: Grey level around the image.

        Raises:
            GeometryError: If the image has no pixels.
        """
        if min(image_size) < 1:
            raise GeometryError(f"an image of {image_size[0]} x {image_size[1]} pixels is empty")
        (width, height), (input_width, input_height) = image_size, input_size
        if fit == "stretch":
            gain = (input_width / width, input_height / height)
            return cls(image_size, input_size, input_size, (0, 0), gain, pad)
        ratio = min(input_width / width, input_height / height)
        if fit == "corner":
            resized = (max(1, int(width * ratio)), max(1, int(height * ratio)))
            return cls(image_size, input_size, resized, (0, 0), (ratio, ratio), pad)
        resized = (max(1, round(width * ratio)), max(1, round(height * ratio)))
        left = round((input_width - resized[0]) / 2 - 0.1)
        top = round((input_height - resized[1]) / 2 - 0.1)
        gain = (resized[0] / width, resized[1] / height)
        return cls(image_size, input_size, resized, (left, top), gain, pad)

    def tensor(
        self,
        image: NDArray[np.uint8],
        pixels: PixelFormat,
        *,
        channels_last: bool = False,
        dtype: str = "float32",
    ) -> NDArray[Any]:
        """Return the network's input for one image.

        Args:
            image: (H, W, 3) uint8 BGR of the planned size.
            pixels: How pixels become numbers.
            channels_last: Whether the tensor is (1, H, W, 3) rather than (1, 3, H, W).
            dtype: Of the tensor, such as `float32`, `float16` or `uint8`.

        Raises:
            GeometryError: If the image is not the planned one.
        """
        height, width = image.shape[:2]
        if (width, height) != self.image_size:
            planned = "{} x {}".format(*self.image_size)
            raise GeometryError(f"an image of {width} x {height} pixels, not {planned}")
        # Bilinear without smoothing, as both families do in training and in their own tools.
        resized = cv2.resize(image, self.resized, interpolation=cv2.INTER_LINEAR)
        working = np.uint8 if dtype == "uint8" else np.float32
        levels = (np.arange(256) * pixels.scale).astype(working)
        (left, top), (width, height) = self.offset, self.resized
        tensor = np.empty((3, *self.input_size[::-1]), working)
        inside = tensor[:, top : top + height, left : left + width]
        for border in (
            tensor[:, :top],
            tensor[:, top + height :],
            tensor[:, :, :left],
            tensor[:, :, left + width :],
        ):
            border[...] = levels[self.pad]
        fill_planes(inside, np.asarray(resized, np.uint8), levels, reverse=pixels.order == "rgb")
        if channels_last:
            tensor = np.ascontiguousarray(tensor.transpose(1, 2, 0))
        return tensor[None].astype(dtype, copy=False)

    def to_image(self, boxes_input_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map boxes (N, 4) x1, y1, x2, y2 from the network's input to the image; not clipped."""
        return (boxes_input_px - self.offset * 2) / (self.gain * 2)

    def to_input(self, boxes_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map boxes (N, 4) x1, y1, x2, y2 from the image to the network's input."""
        return boxes_px * (self.gain * 2) + self.offset * 2
