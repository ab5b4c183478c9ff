"""How an image looks: sharp or not, exposed well or not, and what it resembles.

An image is looked at once, while it is decoded; all that is decided later needs no pixels.
"""

from __future__ import annotations

import base64
import struct
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError, GeometryError

__all__ = ["ImageLook", "look_at"]

_WIDTH, _HIGHEST = 480, 960
_BLUR = 9
_THUMBNAIL = (32, 18)
_DARK, _BRIGHT = 12, 250
_HASHED = 64
_BITS = 256
_DEPTHS = (8, 10, 12, 14, 16)
_LAYOUT = struct.Struct("<4d32s576s")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageLook:
    """What is kept of an image to judge it and to find it again.

    Attributes:
        sharpness: 0..1: the share of the steps from pixel to pixel that strong blurring takes
            away, in the worse of the two directions (one minus the measure of Crete et al.,
            "The blur effect", 2007), 480 pixels wide. Sharp pictures have about 0.7 to 0.8
            whatever they show; noise looks sharp.
        brightness: Mean, 0..1.
        dark_share: Share of the pixels that are as good as black.
        bright_share: Share of the pixels that are as good as white.
        hash: (4,) uint64: which of the 256 lowest frequencies are above their median (Zauner,
            "Implementation and benchmarking of perceptual image hash functions", 2010).
        thumbnail: (18, 32) uint8: the picture in grey, very small.
    """

    sharpness: float
    brightness: float
    dark_share: float
    bright_share: float
    hash: NDArray[np.uint64]
    thumbnail: NDArray[np.uint8]

    def text(self) -> str:
        """Return the look as one word of ASCII, for a journal; nothing is lost."""
        packed = _LAYOUT.pack(
            self.sharpness, self.brightness, self.dark_share, self.bright_share,
            self.hash.astype("<u8").tobytes(), self.thumbnail.tobytes(),
        )  # fmt: skip
        return base64.b64encode(packed).decode("ascii")

    @classmethod
    def from_text(cls, text: str) -> ImageLook:
        """Return the look that `text` wrote.

        Raises:
            DecodeError: If the text is not whole.
        """
        try:
            *numbers, hashed, thumbnail = _LAYOUT.unpack(base64.b64decode(text, validate=True))
        except (ValueError, struct.error) as error:
            raise DecodeError(f"no look of an image: {error}") from error
        sharpness, brightness, dark, bright = numbers
        width, height = _THUMBNAIL
        return cls(
            sharpness=sharpness, brightness=brightness, dark_share=dark, bright_share=bright,
            hash=np.frombuffer(hashed, dtype="<u8").astype(np.uint64),
            thumbnail=np.frombuffer(thumbnail, dtype=np.uint8).reshape(height, width),
        )  # fmt: skip


def look_at(pixels: NDArray[Any]) -> ImageLook:
    """Return the look of an image.

    Args:
        pixels: (H, W) or (H, W, 3) BGR; uint8, or uint16, of which as many low bits are taken to
            be in use, 8, 10, 12, 14 or 16, as the brightest pixel needs.

    Raises:
        GeometryError: If the array is no such picture.
    """
    if pixels.dtype not in (np.uint8, np.uint16) or not _is_picture(pixels.shape):
        raise GeometryError(
            f"a picture is (H, W) or (H, W, 3) uint8 or uint16, not {pixels.shape} {pixels.dtype}"
        )
    grey = _small_grey(pixels)
    half = _halved(grey)
    return ImageLook(
        sharpness=_sharpness(grey),
        brightness=float(grey.mean()) / 255.0,
        dark_share=float(np.count_nonzero(grey <= _DARK) / grey.size),
        bright_share=float(np.count_nonzero(grey >= _BRIGHT) / grey.size),
        hash=_hash(half),
        thumbnail=_resized(half, *_THUMBNAIL),
    )


def _is_picture(shape: tuple[int, ...]) -> bool:
    return len(shape) in (2, 3) and min(shape) > 0 and shape[2:] in ((), (3,))


def _small_grey(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the picture in grey, 480 pixels wide: noise and the sensor's grain are averaged."""
    depth = next(b for b in _DEPTHS if pixels.dtype == np.uint8 or int(pixels.max()) < 1 << b)
    while pixels.shape[1] >= 2 * _WIDTH and pixels.shape[0] >= 2:
        pixels = _halved(pixels)
    small = pixels if pixels.dtype == np.uint8 else (pixels >> (depth - 8)).astype(np.uint8)
    grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY) if small.ndim == 3 else small
    height = min(max(2, round(grey.shape[0] * _WIDTH / grey.shape[1])), _HIGHEST)
    resized = cv2.resize(grey, (_WIDTH, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(resized, np.uint8)


def _halved(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return a picture of half the size; this is several times quicker than any other size."""
    height, width = pixels.shape[0] // 2, pixels.shape[1] // 2
    return _resized(pixels[: 2 * height, : 2 * width], width, height)


def _resized(pixels: NDArray[Any], width: int, height: int) -> NDArray[Any]:
    return cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)


def _sharpness(grey: NDArray[np.uint8]) -> float:
    """Return what blurring takes away, in the direction in which that is less.

    All in integers, so that it is the same on every machine: steps of the sum over `_BLUR`
    pixels are compared with `_BLUR` times the steps of the pixels.
    """
    down = cv2.boxFilter(grey, cv2.CV_16U, (1, _BLUR), normalize=False)
    right = cv2.boxFilter(grey, cv2.CV_16U, (_BLUR, 1), normalize=False)
    return min(
        _lost(cv2.absdiff(grey[1:], grey[:-1]), cv2.absdiff(down[1:], down[:-1])),
        _lost(cv2.absdiff(grey[:, 1:], grey[:, :-1]), cv2.absdiff(right[:, 1:], right[:, :-1])),
    )


def _lost(steps: NDArray[Any], blurred: NDArray[Any]) -> float:
    sharp = steps.astype(np.uint16) * np.uint16(_BLUR)
    # Subtraction of unsigned numbers in OpenCV ends at zero.
    lost = cv2.norm(cv2.subtract(sharp, blurred), cv2.NORM_L1)
    total = cv2.norm(sharp, cv2.NORM_L1)
    return lost / total if total > 0 else 0.0


def _lowest_frequencies() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of the 256 lowest frequencies but the mean, diagonal by diagonal."""
    rows, columns = np.divmod(np.arange(_HASHED * _HASHED), _HASHED)
    order = np.lexsort((rows, rows + columns))[1 : _BITS + 1]
    return rows[order], columns[order]


_FREQUENCIES = _lowest_frequencies()


def _hash(grey: NDArray[np.uint8]) -> NDArray[np.uint64]:
    waves = cv2.dct(_resized(grey, _HASHED, _HASHED).astype(np.float32))[_FREQUENCIES]
    return np.packbits(waves > np.median(waves), bitorder="little").view(np.uint64)
