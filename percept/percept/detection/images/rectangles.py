"""Inputs that are as wide and high as an image asks for, in networks with dynamic shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from percept.core.errors import InputError
from percept.detection.images.letterbox import Letterbox
from percept.detection.networks.cells import strides_of
from percept.detection.networks.decode import decode, main_table
from percept.detection.networks.layout import Layout
from percept.detection.networks.network import Network

__all__ = ["rectangle_for", "stride_of_rectangles"]

_COARSEST_STRIDE = 64  # of any YOLO; where the file does not say, this fits them all
_ROW_AXES = {"v8": 2, "v8-last": 1, "v5": 1, "yolox": 1}  # the layouts with a row for each cell


def rectangle_for(
    image_size: tuple[int, int], largest: tuple[int, int], stride: int
) -> tuple[int, int]:
    """Return the smallest input in steps of the stride that holds an image at full scale.

    A 16:9 image needs 640 x 384 of 640 x 640 pixels, and the network 0.6 of the time
    (ultralytics' `auto` padding).

    Args:
        image_size: (width, height), pixels.
        largest: (width, height) of the whole input, pixels.
        stride: Of the network, pixels.

    Raises:
        GeometryError: If the image has no pixels.
    """
    resized = Letterbox.plan(image_size, largest).resized
    width, height = (-(-length // stride) * stride for length in resized)
    return min(width, largest[0]), min(height, largest[1])


def stride_of_rectangles(
    network: Network, layout: Layout, input_size: tuple[int, int] | None
) -> tuple[int | None, str]:
    """Return the step of the input's sizes, None where it has one size only, and why.

    A network that says that its shapes are dynamic may still hold grids of one size, or resize its
    input itself. It is run once on a rectangle, and gets its whole input where it fails on that or
    does not have a box for each cell of the rectangle.

    Args:
        network: The network.
        layout: How it is fed and read.
        input_size: (width, height) that was asked for; that is then the one size.
    """
    whole = "images: each fills an input of {} x {}".format(*layout.input_size)
    sides = network.image.shape[1:3] if layout.channels_last else network.image.shape[2:4]
    if input_size is not None or layout.fit == "stretch" or sides != (None, None):
        return None, whole
    width, height = layout.input_size
    half = max(_COARSEST_STRIDE, height // 2 // _COARSEST_STRIDE * _COARSEST_STRIDE)
    stride = _stride_on(network, replace(layout, input_size=(width, half)))
    if stride is None:
        return None, f"{whole}, since the network does not follow smaller ones"
    return stride, f"images: each gets the smallest input for its shape, in steps of {stride} px"


def _stride_on(network: Network, layout: Layout) -> int | None:
    """Return the coarsest stride of a network on an input, or None where it does not work on it."""
    width, height = layout.input_size
    shape = (height, width, 3) if layout.channels_last else (3, height, width)
    grey = np.full((network.image.shape[0] or 1, *shape), layout.pad * layout.pixels.scale)
    try:
        outputs = network.run(grey)
        decode(layout, outputs, 0, 1.0)
    except InputError:
        return None
    if layout.name not in _ROW_AXES:
        return _declared_stride(network)
    rows = main_table(outputs).shape[_ROW_AXES[layout.name]]
    strides = strides_of(layout.input_size, rows) or strides_of(layout.input_size, rows // 3)
    return None if strides is None else max(strides)


def _declared_stride(network: Network) -> int:
    text = network.metadata.get("stride", "")
    known = text.isdigit() and int(text) in (8, 16, 32, 64, 128)
    return int(text) if known else _COARSEST_STRIDE
