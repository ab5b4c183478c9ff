"""A network in ONNX that marks the paint of road lines in an image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError, InputError
from percept.detection.networks.network import Device, Network, open_network

__all__ = ["RoadLineNetwork"]

_USUAL_SIZE = (640, 384)  # width and height where the network takes any
_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
_SD = np.array([0.229, 0.224, 0.225], dtype=np.float32)


class RoadLineNetwork:
    """A segmentation network for road lines, ready to look at images.

    It takes RGB of 0..1 (or normalised with ImageNet's mean and spread, with `imagenet`), or 0..255
    where its input is of bytes, and puts out logits or probabilities: one channel is paint; of
    several, the first is the ground and all others are kinds of lines. A second output with other
    sizes, such as an embedding, is not read.

    Attributes:
        network: The network itself.
    """

    def __init__(
        self, path: str | Path, *, imagenet: bool = False, device: Device = "auto", threads: int = 1
    ) -> None:
        """Open a network.

        Args:
            path: An ONNX file.
            imagenet: Whether the network was trained on images that were normalised so.
            device: What it shall run on.
            threads: Number of threads inside of one run.

        Raises:
            InputError: If the file must not or cannot be opened, or is no such network.
        """
        self.network: Network = open_network(Path(path), device=device, threads=threads)
        self._imagenet = imagenet
        self._output = self._mask_output()

    def mask(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return how likely each pixel is paint: (H, W) float32 0..1.

        Args:
            image: (H, W, 3) uint8 BGR.

        Raises:
            GeometryError: If the image is none.
            InputError: If the network fails or puts out something else than a mask.
        """
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
            raise GeometryError(f"an image is (H, W, 3) uint8, not {image.shape} {image.dtype}")
        output = self.network.run(self._tensor(image))[self._output]
        scores = np.asarray(output, dtype=np.float32)
        if scores.ndim != 4 or scores.shape[0] != 1 or not np.isfinite(scores).all():
            raise InputError(f"it puts out {list(scores.shape)}, no mask", where=self.network.path)
        paint = _paint(scores[0])
        height, width = image.shape[:2]
        resized = cv2.resize(paint, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(resized, dtype=np.float32)

    def _mask_output(self) -> int:
        for k, spec in enumerate(self.network.outputs):
            if len(spec.shape) == 4 and spec.dtype.startswith("float"):
                return k
        found = "; ".join(map(str, self.network.outputs))
        raise InputError(
            f"it is no network for road lines: its outputs are {found}",
            where=self.network.path,
            remedy="Such a network puts out [1, channels, height, width]",
        )

    def _tensor(self, image: NDArray[np.uint8]) -> NDArray[Any]:
        axes = self.network.image.shape
        rows, columns = axes[1:3] if self.network.channels_last else axes[2:4]
        size = (columns or _USUAL_SIZE[0], rows or _USUAL_SIZE[1])
        rgb = cv2.cvtColor(cv2.resize(image, size, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
        planes: NDArray[Any] = rgb if self.network.channels_last else rgb.transpose(2, 0, 1)
        if self.network.image.dtype == "uint8":
            return np.ascontiguousarray(planes[None])
        scaled = planes.astype(np.float32) / 255
        if self._imagenet:
            shape = (1, 1, 3) if self.network.channels_last else (3, 1, 1)
            scaled = (scaled - _MEAN.reshape(shape)) / _SD.reshape(shape)
        return np.ascontiguousarray(scaled[None])


def _paint(scores: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return paint (H, W) 0..1 of channels (C, H, W) of probabilities or logits."""
    probable = bool(scores.min() >= 0 and scores.max() <= 1)
    if len(scores) == 1:
        one = scores[0] if probable else 1 / (1 + np.exp(-np.clip(scores[0], -30, 30)))
        return np.asarray(one, dtype=np.float32)
    if not probable:
        raised = np.exp(scores - scores.max(axis=0))
        scores = raised / raised.sum(axis=0)
    return np.asarray(np.clip(scores[1:].sum(axis=0), 0, 1), dtype=np.float32)
