"""Images for a calibration: decoded, and of a log the stillest ones."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.samples import CameraImage

__all__ = ["StillImages", "decode_image"]

_SMALL = (96, 64)  # size at which two images are compared


def decode_image(content: bytes, name: str) -> NDArray[np.uint8]:
    """Return the pixels (H, W, 3) BGR of an image file's content.

    Raises:
        InputError: If it is no image that can be decoded; names the image.
    """
    if not content:
        raise InputError("it is empty", where=name)
    decoded = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if decoded is None:
        raise InputError("no image that OpenCV can decode", where=name)
    return np.asarray(decoded, dtype=np.uint8)


class StillImages:
    """Of each slot of time, the image that differs least from the one before it.

    A moving board or camera smears the corners, and neighbouring images say the same.

    Args:
        first_ns: Log time at which the first slot begins.
        last_ns: Log time at which the last slot ends.
        slots: How many slots there are: the most images to keep.
    """

    def __init__(self, first_ns: int, last_ns: int, slots: int) -> None:
        self._first = first_ns
        self._slot_ns = max((last_ns - first_ns) // slots + 1, 1)
        self._before: NDArray[np.float32] | None = None
        self._best: dict[int, tuple[float, int, bytes]] = {}
        self.looked_at = 0
        self.frame: str | None = None
        self.unusable: Counter[str] = Counter()

    def push(self, image: CameraImage) -> None:
        """Look at the next image of the log."""
        if image.pixels.dtype != np.uint8:
            self.unusable[f"image of {image.pixels.dtype} instead of 8 bits"] += 1
            return
        self.looked_at, self.frame = self.looked_at + 1, image.frame
        small = _small(image.pixels)
        change = np.inf if self._before is None else float(np.abs(small - self._before).mean())
        self._before = small
        slot = (image.log_time_ns - self._first) // self._slot_ns
        if slot not in self._best or change < self._best[slot][0]:
            _, content = cv2.imencode(".png", image.pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            self._best[slot] = (change, image.stamp_ns, content.tobytes())

    def encoded(self) -> dict[str, bytes]:
        """Return the images by name, in the order of their slots."""
        return {f"{stamp}.png": png for _, (_, stamp, png) in sorted(self._best.items())}


def _small(pixels: NDArray[np.generic]) -> NDArray[np.float32]:
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(np.asarray(pixels), cv2.COLOR_BGR2GRAY)
    return cv2.resize(np.asarray(grey), _SMALL, interpolation=cv2.INTER_AREA).astype(np.float32)
