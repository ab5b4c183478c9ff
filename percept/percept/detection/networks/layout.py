"""What a network wants in and gives out: everything that was resolved about an ONNX file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Layout", "PixelFormat"]


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
        counts_classes: Whether there are as many classes as names. A network that puts out finished
            boxes does not tell; where nobody names its classes, the list is just long enough.
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
    counts_classes: bool = True
