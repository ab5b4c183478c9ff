"""The files of one image: as it was recorded, and without distortion.

The pixels are decoded once. Where nothing is blurred the recorded JPEG or PNG is written as it is;
where something is, only what is blurred is ever written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import InputError
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage
from percept.core.settings import Settings
from percept.datasets.labelling.choice.image_look import ImageLook, look_at
from percept.datasets.labelling.images.anonymise import Anonymiser
from percept.datasets.labelling.images.rectify import has_distortion, rectify_image

__all__ = ["ImageConfig", "ImageWriter", "WrittenImage"]

_SUFFIXES = {"jpeg": ".jpg", "png": ".png"}
_JPEG_END = b"\xff\xd9"
_EXIF = b"Exif\0\0"
_HEAD_BYTES = 1 << 16


class ImageConfig(Settings):
    """How images are written.

    Attributes:
        jpeg_quality: Of images that have to be encoded anew, 1..100.
    """

    jpeg_quality: int = Field(default=95, ge=1, le=100)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WrittenImage:
    """An image whose files are there.

    Attributes:
        file: The recorded image, below the folder.
        rectified_file: The image without distortion; None where none was wanted.
        image_size: (width, height).
        look: How it looks.
        blurred: Number of regions that were blurred, by kind.
    """

    file: str
    rectified_file: str | None
    image_size: tuple[int, int]
    look: ImageLook
    blurred: Mapping[str, int]


class ImageWriter:
    """Writes the files of images below one folder; for several threads at once.

    Args:
        folder: The folder; `images` and `rectified` are made in it.
        config: Settings.
        rectified_suffix: `.jpg` or `.png` to write images without distortion; None for none.
        anonymiser: What makes persons unknown; None writes images as they were recorded.
    """

    def __init__(
        self,
        folder: Path,
        config: ImageConfig,
        *,
        rectified_suffix: str | None = None,
        anonymiser: Anonymiser | None = None,
    ) -> None:
        self._folder = folder
        self._quality = config.jpeg_quality
        self._suffix = rectified_suffix
        self._anonymiser = anonymiser
        for name in ("images", "rectified"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def write(self, image: CameraImage, stem: str, sensor: CameraSensor | None) -> WrittenImage:
        """Write the files of an image.

        Args:
            image: The image.
            stem: Name of its files without suffix.
            sensor: The camera; None where the lens is not known, and nothing can be rectified.

        Raises:
            InputError: If the pixels are no picture.
            GeometryError: If the image has not the size that the lens is known for.
            OSError: If a file cannot be written.
        """
        pixels = _as_8bit(image)
        look = look_at(pixels)
        blurred: Mapping[str, int] = {}
        recorded = image.file
        if self._anonymiser is not None:
            anonymised = self._anonymiser.anonymise(pixels)
            pixels, blurred, recorded = anonymised.pixels, anonymised.counts, None
        file = self._recorded(pixels, stem, recorded)
        rectified = None
        if self._suffix is not None and sensor is not None:
            rectified = self._rectified(pixels, stem, file, sensor)
        height, width = pixels.shape[:2]
        return WrittenImage(
            file=file,
            rectified_file=rectified,
            image_size=(width, height),
            look=look,
            blurred=blurred,
        )

    def _recorded(self, pixels: NDArray[np.uint8], stem: str, recorded: bytes | None) -> str:
        """Write the recorded file if it is fit for that, else the pixels."""
        suffix = None if recorded is None else _suffix_of(recorded, pixels)
        if recorded is None or suffix is None:
            file = f"images/{stem}.jpg"
            self._save(pixels, file)
            return file
        file = f"images/{stem}{suffix}"
        if suffix == ".jpg":
            # Some loaders encode a file anew, in place, that does not end with its end mark.
            recorded = recorded[: recorded.rfind(_JPEG_END) + len(_JPEG_END)]
        (self._folder / file).write_bytes(recorded)
        return file

    def _rectified(
        self, pixels: NDArray[np.uint8], stem: str, file: str, sensor: CameraSensor
    ) -> str:
        if not has_distortion(sensor) and file.endswith(self._suffix or ""):
            return file
        rectified = f"rectified/{stem}{self._suffix}"
        self._save(rectify_image(pixels, sensor), rectified)
        return rectified

    def _save(self, pixels: NDArray[Any], file: str) -> None:
        path = self._folder / file
        path.write_bytes(_jpeg(pixels, self._quality) if path.suffix == ".jpg" else _png(pixels))


def _as_8bit(image: CameraImage) -> NDArray[np.uint8]:
    """Return pixels of 8 bits; of 16 the upper ones that are used.

    A sensor of 10 or 12 bits uses the lower bits of 16: the brightest pixel tells how many.
    """
    pixels = image.pixels
    if pixels.dtype == np.uint16:
        used = max(int(pixels.max(initial=0)).bit_length(), 8)
        # Of a dark image few bits are in use: 10 are the least that such a sensor has.
        pixels = pixels >> (max(used, 10) - 8)
    elif pixels.dtype != np.uint8:
        raise InputError(f"pixels of {pixels.dtype} are no picture", where=image.topic)
    return np.ascontiguousarray(pixels, dtype=np.uint8)


def _suffix_of(recorded: bytes, pixels: NDArray[np.uint8]) -> str | None:
    """Return the suffix of a recorded file; None if it must be encoded anew.

    A file with EXIF may say that it is to be turned, and then tools turn it under the boxes; it may
    also tell who took it where.
    """
    name = "jpeg" if recorded.startswith(b"\xff\xd8") else "png"
    deep = name == "png" and recorded[24:25] == b"\x10"
    if deep or _EXIF in recorded[:_HEAD_BYTES] or not pixels.size:
        return None
    return _SUFFIXES[name]


def _jpeg(pixels: NDArray[Any], quality: int) -> bytes:
    if pixels.ndim == 2:
        grey = np.ascontiguousarray(pixels[:, :, None])
        return bytes(
            simplejpeg.encode_jpeg(grey, quality, colorspace="GRAY", colorsubsampling="Gray")
        )
    colour = np.ascontiguousarray(pixels)
    return bytes(simplejpeg.encode_jpeg(colour, quality, colorspace="BGR", colorsubsampling="420"))


def _png(pixels: NDArray[Any]) -> bytes:
    # The lowest level: higher ones take many times as long for a few per cent.
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return encoded.tobytes()
