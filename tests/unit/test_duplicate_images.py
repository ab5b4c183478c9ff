"""Pictures that show again what another shows, made ones."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_looks import look_of_place, picture_of_place
from numpy.typing import NDArray

from percept.datasets.labelling.choice.duplicates import DuplicateConfig, DuplicateFinder
from percept.datasets.labelling.choice.image_look import look_at

_PICTURE = picture_of_place(3, 1280, 720)


def _encoded(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 30])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


_EDITS = {
    "none": _PICTURE,
    "encoded again": _encoded(_PICTURE),
    "scaled": cv2.resize(_PICTURE, None, fx=0.9, fy=0.9, interpolation=cv2.INTER_AREA),
    "half": cv2.resize(_PICTURE, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_LINEAR),
    "brighter": cv2.convertScaleAbs(_PICTURE, alpha=1.1, beta=15),
    "darker": cv2.convertScaleAbs(_PICTURE, alpha=0.7),
    "gamma": (255 * (_PICTURE / 255.0) ** 0.7).astype(np.uint8),
    "noise": picture_of_place(3, 1280, 720, deviation=8.0),
}


@pytest.mark.parametrize("edit", _EDITS)
def test_edited_copies_are_found(edit: str) -> None:
    finder = DuplicateFinder(DuplicateConfig())
    for number in range(6):
        assert finder.offer(look_of_place(number)) is None
    assert finder.offer(look_at(np.asarray(_EDITS[edit]))) == 3


def test_somebody_who_enters_makes_it_another_picture() -> None:
    finder = DuplicateFinder(DuplicateConfig())
    street = _PICTURE.copy()
    street[300:460, 500:564] = (90, 90, 90)
    entered = street.copy()
    entered[320:440, 510:555] = (40, 30, 160)
    assert finder.offer(look_at(street)) is None
    hashes = look_at(street).hash ^ look_at(entered).hash
    assert int(np.bitwise_count(hashes).sum()) <= DuplicateConfig().most_bits
    assert finder.offer(look_at(entered)) is None


def test_the_number_is_that_of_the_copied_among_all_that_were_offered() -> None:
    finder = DuplicateFinder(DuplicateConfig())
    places = [0, 0, 1, 0, 2, 1, 2, 2]
    found = [finder.offer(look_of_place(place)) for place in places]
    assert found == [None, 0, None, 0, None, 2, 4, 4]


def test_the_nearest_of_several_is_meant() -> None:
    finder = DuplicateFinder(DuplicateConfig(most_change=0.001))
    look = look_of_place(0)
    other = replace(look, thumbnail=look.thumbnail.copy())
    other.thumbnail[0, 0] ^= 64
    assert [finder.offer(other), finder.offer(look), finder.offer(look)] == [None, None, 1]


def test_images_of_one_moment_are_no_duplicates_of_each_other() -> None:
    finder, look = DuplicateFinder(DuplicateConfig()), look_of_place(0)
    assert [finder.offer(look, group=g) for g in (0, 0, 1, 0)] == [None, None, 0, None]
    assert finder.offer(look) == 0


def test_many_pictures_all_find_their_copy() -> None:
    finder, base = DuplicateFinder(DuplicateConfig()), look_of_place(0)
    random = np.random.default_rng(0)
    hashes = random.integers(0, 2**64, (600, 4), dtype=np.uint64)
    looks = [replace(base, hash=hashed) for hashed in hashes]
    assert [finder.offer(look) for look in looks] == [None] * 600
    assert [finder.offer(look) for look in looks[::-1]] == list(range(600))[::-1]


def test_dark_pictures_of_noise_are_not_told_apart_by_their_hash_alone() -> None:
    finder = DuplicateFinder(DuplicateConfig(most_bits=255))
    assert finder.offer(look_of_place(0)) is None
    assert finder.offer(look_of_place(1)) is None
