"""The images of a data set: each file is read once, however many names it has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.core.errors import DecodeError, InputError
from percept.datasets.decoding.images import ENCODED_FORMATS, pixels_of_file_bytes
from percept.datasets.labelling.check.folder import Folder
from percept.datasets.labelling.choice.image_look import ImageLook, look_at

__all__ = ["IMAGE_SUFFIXES", "Picture", "read_pictures"]

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
"""Ends of the names of images."""

_LARGEST_BYTES = 1 << 29
_THREADS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What is kept of an image.

    Attributes:
        digest: Of its bytes; empty where it cannot be read.
        size: (width, height); None where it is damaged.
        look: How it looks; None where it is damaged.
        damage: What is wrong with it; empty where nothing is.
    """

    digest: bytes
    size: tuple[int, int] | None = None
    look: ImageLook | None = None
    damage: str = ""


def read_pictures(folder: Folder, names: Iterable[str]) -> Mapping[str, Picture]:
    """Return the pictures of files that are listed, by name.

    Args:
        folder: Their folder.
        names: Their names in it.
    """
    names = list(names)
    first = {folder.files[name].place: name for name in reversed(names)}
    with ThreadPoolExecutor(_THREADS) as threads:
        read = threads.map(lambda name: _read(folder.path(name)), first.values())
        by_place = dict(zip(first, read, strict=True))
    return {name: by_place[folder.files[name].place] for name in names}


def _read(path: Path) -> Picture:
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            return Picture(b"", damage="is larger than 512 MiB")
        data = path.read_bytes()
    except OSError as error:
        return Picture(b"", damage=f"cannot be read ({error.strerror})")
    digest = blake2b(data, digest_size=16).digest()
    try:
        pixels = _pixels(data, path.name)
        height, width = pixels.shape[:2]
        return Picture(digest, (width, height), look_at(pixels))
    except (InputError, cv2.error) as error:
        what = error.what if isinstance(error, InputError) else "cannot be decoded"
        return Picture(digest, damage=what)


def _pixels(data: bytes, name: str) -> NDArray[Any]:
    """Return the pixels of an image: JPEG and PNG have to be whole; the rest goes to OpenCV."""
    if data.startswith(tuple(ENCODED_FORMATS)):
        return pixels_of_file_bytes(data, name)[0]
    if not data:
        raise DecodeError("is empty", where=name)
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if pixels is None:
        raise DecodeError("is no image", where=name)
    return pixels
