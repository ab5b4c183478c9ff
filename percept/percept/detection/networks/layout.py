"""What a network wants in and gives out: everything that was resolved about an ONNX file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Candidates", "Layout", "PixelFormat"]


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """How pixels become the numbers of the input tensor.

    Attributes:
        order: Order of the colour channels.
        scale: Factor on the values 0..255: 1/255, or 1 for networks that take them as they are.
    """

    order: Literal["rgb", "bgr"] = "rgb"
    scale: float = 1 / 255


@dataclass(frozen=True, slots=True)
class Layout:
    """How images go into a network and how its output tensors are read.

    Attributes:
        name: Of the decoding, such as `v8` or `yolox`; what `--layout` takes.
        class_names: Names by class number.
        input_size: (width, height) of the network's input, pixels.
        channels_last: Whether the input tensor is NHWC rather than NCHW.
        pixels: How pixels become numbers.
        fit: How an image is brought to the input size: `centre` and `corner` keep its shape and
            pad around it or at the right and bottom; `stretch` does not.
        pad: Grey level of the padding.
        needs_nms: Whether duplicates have yet to be suppressed.
        why: How each of these was found, in words.
    """

    name: str
    class_names: tuple[str, ...]
    input_size: tuple[int, int]
    channels_last: bool = False
    pixels: PixelFormat = PixelFormat()
    fit: Literal["centre", "corner", "stretch"] = "centre"
    pad: int = 114
    needs_nms: bool = True
    why: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Boxes that a network puts out for one image, before suppression.

    Attributes:
        boxes_input_px: (N, 4) float64 x1, y1, x2, y2 in the network's input image.
        class_ids: (N,) int64.
        scores: (N,) float64 in 0..1.
    """

    boxes_input_px: NDArray[np.float64]
    class_ids: NDArray[np.int64]
    scores: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.scores)
