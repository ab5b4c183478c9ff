"""Files of images: the recorded bytes where they are fit, else the pixels encoded anew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.samples import CameraImage
from percept.datasets.labelling.images.image_files import ImageConfig, ImageWriter

_EXIF = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"


def _pixels() -> NDArray[np.uint8]:
    random = np.random.default_rng(1)
    return cv2.resize(random.integers(0, 256, (6, 10, 3), np.uint8), (160, 96)).astype(np.uint8)


def _encoded(pixels: NDArray[Any], suffix: str = ".jpg") -> bytes:
    return cv2.imencode(suffix, pixels)[1].tobytes()


def _written(folder: Path, pixels: NDArray[Any], file: bytes | None) -> Path:
    writer = ImageWriter(folder, ImageConfig())
    image = CameraImage(topic="/a", stamp_ns=1, log_time_ns=1, frame="a", pixels=pixels, file=file)
    done = writer.write(image, "name", None)
    assert done.image_size == (pixels.shape[1], pixels.shape[0])
    return folder / done.file


def test_a_recorded_file_stays_as_it_is(tmp_path: Path) -> None:
    for suffix in (".jpg", ".png"):
        file = _encoded(_pixels(), suffix)
        path = _written(tmp_path, _pixels(), file)
        assert (path.suffix, path.read_bytes()) == (suffix, file)


def test_what_follows_the_end_of_a_jpeg_is_cut_off(tmp_path: Path) -> None:
    file = _encoded(_pixels())
    for behind in (bytes(7), b"\n"):
        assert _written(tmp_path, _pixels(), file + behind).read_bytes() == file


def test_a_file_that_says_how_to_turn_it_is_encoded_anew(tmp_path: Path) -> None:
    file = _encoded(_pixels())
    segment = b"\xff\xe1" + (len(_EXIF) + 2).to_bytes(2, "big") + _EXIF
    path = _written(tmp_path, _pixels(), file[:2] + segment + file[2:])
    assert b"Exif" not in path.read_bytes()
    shown = cv2.imread(str(path))
    assert shown is not None
    assert np.abs(shown.astype(int) - _pixels()).mean() < 5


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_pixels_become_8_bits(tmp_path: Path, bits: int) -> None:
    grey = _pixels()[:, :, 0].copy()
    grey[0, 0] = 255
    deep = grey.astype(np.uint16) << (bits - 8)
    for file in (None, _encoded(deep, ".png")):
        shown = cv2.imread(str(_written(tmp_path, deep, file)), cv2.IMREAD_UNCHANGED)
        assert shown is not None
        assert shown.dtype == np.uint8
        assert shown.shape == grey.shape
        assert np.abs(shown.astype(int) - grey).mean() < 5


def test_depths_in_metres_are_no_picture(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="are no picture"):
        _written(tmp_path, np.ones((4, 4), np.float32), None)
