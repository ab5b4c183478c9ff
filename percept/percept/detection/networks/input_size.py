"""The size of the input, and the pictures that a network is tried on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.detection.networks.hints import Hints
from percept.detection.networks.network import Network

__all__ = ["choose_input_size", "trial_pictures"]

_USUAL = (640, 640)
_USUAL_STRIDE = 32


def choose_input_size(
    network: Network, hints: Hints, wanted: tuple[int, int] | None
) -> tuple[tuple[int, int], str]:
    """Return the (width, height) of the input and where it comes from.

    Args:
        network: Fixed axes of its input cannot be changed.
        hints: Its metadata.
        wanted: (width, height) that was asked for.

    Raises:
        UsageError: If the network cannot take the size that was asked for.
    """
    axes = network.image.shape[1:3] if network.channels_last else network.image.shape[2:4]
    fixed_height, fixed_width = axes
    width, height = wanted or hints.image_size or _USUAL
    size = (fixed_width or width, fixed_height or height)
    if wanted is not None and size != wanted:
        raise UsageError(
            f"the input size {wanted[0]} x {wanted[1]} cannot be had: the network takes "
            f"{size[0]} x {size[1]} only",
            where=network.path,
            remedy="Leave the input size out, or export the network with dynamic shapes",
        )
    if None not in axes:
        return size, "fixed by the network"
    if wanted is None:
        return size, "from its metadata" if hints.image_size else "the usual one"
    stride = hints.stride or _USUAL_STRIDE
    if wanted[0] % stride or wanted[1] % stride:
        near = [max(stride, round(n / stride) * stride) for n in wanted]
        raise UsageError(
            f"the input size {wanted[0]} x {wanted[1]} is no multiple of {stride} pixels",
            where=network.path,
            remedy=f"Take {near[0]} x {near[1]}",
        )
    return size, "asked for"


def trial_pictures(
    network: Network, size: tuple[int, int], white: float
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a plain grey and a textured picture as tensors for a network.

    Args:
        network: That they are for.
        size: (width, height) of its input.
        white: The number that stands for white.
    """
    width, height = size
    grey = np.full((height, width, 3), 0.45, np.float32)
    return (_as_tensor(network, grey, white), _as_tensor(network, _textured(size), white))


def _textured(size: tuple[int, int]) -> NDArray[np.float32]:
    """Return a picture (H, W, 3) 0..1 of a colour gradient with rectangles and some noise."""
    random = np.random.default_rng(0)
    width, height = size
    y, x = np.mgrid[:height, :width] / max(size)
    picture = 0.6 * np.stack([x, y, 1 - x], axis=2)
    for _ in range(40):
        left, top = random.integers(0, size)
        w, h = random.integers(4, 4 + max(size) // 6, 2)
        picture[top : top + h, left : left + w] = random.uniform(0, 1, 3)
    picture += random.normal(0, 0.03, picture.shape)
    return picture.clip(0, 1).astype(np.float32)


def _as_tensor(network: Network, picture: NDArray[np.float32], white: float) -> NDArray[Any]:
    tensor = picture if network.channels_last else picture.transpose(2, 0, 1)
    return np.repeat(tensor[None] * np.float32(white), network.image.shape[0] or 1, axis=0)
