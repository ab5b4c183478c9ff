"""How pictures look, and which of them are too poor."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_looks import look_of_place, picture_of_place
from numpy.typing import NDArray

from percept.core.errors import DecodeError, GeometryError
from percept.datasets.labelling.choice.image_look import ImageLook, look_at
from percept.datasets.labelling.choice.image_quality import QualityConfig, poor_images

_PICTURE = picture_of_place(1)
_CONFIG = QualityConfig()


def _same(one: ImageLook, other: ImageLook) -> bool:
    return one.text() == other.text()


def _bits(one: ImageLook, other: ImageLook) -> int:
    return int(np.bitwise_count(one.hash ^ other.hash).sum())


def _blurred(sigma: float) -> NDArray[np.uint8]:
    return np.asarray(cv2.GaussianBlur(_PICTURE, (0, 0), sigma), np.uint8)


def test_a_look_goes_through_text_unchanged() -> None:
    look = look_at(_PICTURE)
    again = ImageLook.from_text(look.text())
    assert _same(look, again)
    assert (again.sharpness, again.dark_share) == (look.sharpness, look.dark_share)
    np.testing.assert_array_equal(again.hash, look.hash)
    np.testing.assert_array_equal(again.thumbnail, look.thumbnail)
    assert look.text().isascii()
    assert not set(look.text()) & set(' "\\\n')


@pytest.mark.parametrize("text", ["", "AAAA", "not base64!", "ü"])
def test_text_that_is_not_whole_is_refused(text: str) -> None:
    with pytest.raises(DecodeError, match="no look of an image"):
        ImageLook.from_text(text)


def test_grey_and_colour_of_one_picture_look_alike() -> None:
    grey = cv2.cvtColor(_PICTURE, cv2.COLOR_BGR2GRAY)
    assert _bits(look_at(_PICTURE), look_at(grey)) <= 2
    assert look_at(_PICTURE).brightness == pytest.approx(look_at(grey).brightness, abs=0.005)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
def test_pictures_of_many_bits_look_as_those_of_eight(bits: int) -> None:
    deep = (_PICTURE.astype(np.uint16) << (bits - 8)) + np.uint16((1 << (bits - 8)) - 1)
    deep[0, 0] = (1 << bits) - 1
    plain, look = look_at(_PICTURE), look_at(deep)
    assert _bits(plain, look) <= 2
    assert look.brightness == pytest.approx(plain.brightness, abs=0.005)
    assert look.sharpness == pytest.approx(plain.sharpness, abs=0.02)


@pytest.mark.parametrize("shape", [(1, 1), (1, 900), (900, 1), (2, 3, 3), (1500, 7, 3)])
def test_odd_sizes_have_a_look(shape: tuple[int, ...]) -> None:
    look = look_at(np.full(shape, 80, np.uint8))
    assert look.sharpness == 0.0
    assert look.brightness == pytest.approx(80 / 255)


@pytest.mark.parametrize(
    "pixels",
    [
        np.zeros((4, 4), np.float32),
        np.zeros((4, 4), np.int32),
        np.zeros((4, 0), np.uint8),
        np.zeros((4, 4, 4), np.uint8),
        np.zeros(4, np.uint8),
    ],
)
def test_what_is_no_picture_is_refused(pixels: NDArray[np.generic]) -> None:
    with pytest.raises(GeometryError, match="a picture is"):
        look_at(pixels)


def test_the_size_of_a_picture_hardly_matters() -> None:
    look = look_at(picture_of_place(1, 1280, 720))
    for width, height in ((1920, 1080), (960, 540), (3840, 2160)):
        other = look_at(picture_of_place(1, width, height))
        assert _bits(look, other) <= 4
        assert np.abs(look.thumbnail.astype(int) - other.thumbnail).max() <= 2


def test_blur_takes_sharpness_away() -> None:
    found = [look_at(_PICTURE).sharpness, *(look_at(_blurred(s)).sharpness for s in (1, 2, 4, 8))]
    assert np.all(np.diff(found) < 0)
    assert found[0] > 0.6 > 0.4 > found[3]


def test_motion_in_one_direction_is_blur() -> None:
    kernel = np.full((1, 31), 1 / 31, np.float32)
    along = look_at(np.asarray(cv2.filter2D(_PICTURE, -1, kernel), np.uint8))
    down = look_at(np.asarray(cv2.filter2D(_PICTURE, -1, kernel.T), np.uint8))
    assert max(along.sharpness, down.sharpness) < 0.45


def test_poor_pictures_are_told_apart() -> None:
    good = [look_of_place(n) for n in range(8)]
    poor = {
        "under-exposed": (_PICTURE * 0.05).astype(np.uint8),
        "over-exposed": cv2.convertScaleAbs(_PICTURE, alpha=4.0),
        "empty": np.full_like(_PICTURE, 120),
        "blurred": _blurred(5.0),
    }
    looks = [*good, *(look_at(np.asarray(p)) for p in poor.values())]
    assert poor_images(looks, _CONFIG) == (*[None] * 8, *poor)


def test_a_camera_that_is_always_soft_is_not_dropped() -> None:
    looks = [look_at(_blurred(2.5 + 0.01 * n)) for n in range(6)]
    assert max(look.sharpness for look in looks) < _CONFIG.least_sharpness
    assert poor_images(looks, _CONFIG) == (None,) * 6


def test_pictures_softer_than_usual_but_sharp_are_not_dropped() -> None:
    sharp = look_of_place(1)
    softer = replace(sharp, sharpness=0.61)
    assert poor_images([replace(sharp, sharpness=0.9)] * 5 + [softer], _CONFIG) == (None,) * 6


def test_no_pictures_no_reasons() -> None:
    assert poor_images([], _CONFIG) == ()
