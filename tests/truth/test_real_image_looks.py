"""Looks of real pictures: copies, other places, blur and exposure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from real_lanes import video_frames

from percept.datasets.labelling.choice.duplicates import DuplicateConfig, DuplicateFinder
from percept.datasets.labelling.choice.image_look import ImageLook, look_at
from percept.datasets.labelling.choice.image_quality import QualityConfig, poor_images
from percept.datasets.labelling.choice.selection import Candidate, Decision, SelectionConfig, decide

_CONFIG = QualityConfig()

Picture = NDArray[np.uint8]


@pytest.fixture(scope="module")
def clip(shared_data: Path) -> list[Picture]:
    """9 s of an open motorway, 25 frames a second, which are somewhat over a metre apart."""
    return video_frames(shared_data / "lane" / "carnd_p1" / "solidWhiteRight.mp4")


@pytest.fixture(scope="module")
def looks(clip: list[Picture]) -> list[ImageLook]:
    return [look_at(picture) for picture in clip]


@pytest.fixture(scope="module")
def stills(shared_data: Path) -> dict[str, Picture]:
    """Pictures of six cameras: motorways, towns, a board in a yard."""
    patterns = (
        "lane/carnd_*/*.jpg", "lane/tusimple_lanenet/tusimple_test_image/*.jpg",
        "scenes/kitti*/**/*.png", "scenes/sustechpoints/camera/*/*.jpg",
        "camera_lidar/acfr_vlp/images/pose1.jpg",
    )  # fmt: skip
    files = [file for pattern in patterns for file in sorted(shared_data.glob(pattern))]
    return {str(file.relative_to(shared_data)): _read(file) for file in files}


def _read(file: Path) -> Picture:
    return np.asarray(cv2.imread(str(file), cv2.IMREAD_COLOR), np.uint8)


def _encoded(picture: Picture) -> Picture:
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 30])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def _scaled(picture: Picture) -> Picture:
    small = cv2.resize(picture, None, fx=0.9, fy=0.9, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _brighter(picture: Picture) -> Picture:
    return np.asarray(cv2.convertScaleAbs(picture, alpha=1.1, beta=20), np.uint8)


def _noisy(picture: Picture) -> Picture:
    noise = np.random.default_rng(0).normal(0.0, 8.0, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def _out_of_focus(picture: Picture) -> Picture:
    sigma = 0.0035 * picture.shape[1]
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)


def _moved(picture: Picture) -> Picture:
    width = round(0.02 * picture.shape[1]) | 1
    return np.asarray(cv2.blur(picture, (width, 1)), np.uint8)


@pytest.mark.parametrize("edit", [_encoded, _scaled, _brighter, _noisy])
def test_copies_of_real_frames_are_found(
    clip: list[Picture], looks: list[ImageLook], edit: Callable[[Picture], Picture]
) -> None:
    finder = DuplicateFinder(DuplicateConfig())
    chosen = range(0, len(clip), 20)
    assert [finder.offer(looks[i]) for i in chosen] == [None] * len(chosen)
    copies = [finder.offer(look_at(edit(clip[i]))) for i in chosen]
    assert copies == list(range(len(chosen)))


def test_an_empty_motorway_five_metres_on_is_another_picture(looks: list[ImageLook]) -> None:
    for first in range(5):
        finder = DuplicateFinder(DuplicateConfig())
        assert [finder.offer(look) for look in looks[first::5]] == [None] * len(looks[first::5])


def test_pictures_of_other_places_are_no_duplicates(
    stills: dict[str, Picture], looks: list[ImageLook]
) -> None:
    finder = DuplicateFinder(DuplicateConfig())
    assert finder.offer(looks[0]) is None
    found = {name: finder.offer(look_at(picture)) for name, picture in stills.items()}
    assert len(found) >= 15
    assert {name for name, of in found.items() if of is not None} == set()


def test_no_real_frame_is_poor(stills: dict[str, Picture], looks: list[ImageLook]) -> None:
    assert set(poor_images(looks, _CONFIG)) == {None}
    for name, picture in stills.items():
        assert poor_images([look_at(picture)], _CONFIG) == (None,), name


@pytest.mark.parametrize("edit", [_out_of_focus, _moved])
def test_a_blurred_picture_among_sharp_ones_is_found(
    stills: dict[str, Picture], edit: Callable[[Picture], Picture]
) -> None:
    for name, picture in stills.items():
        sharp = look_at(picture)
        reasons = poor_images([sharp, sharp, look_at(edit(picture)), sharp], _CONFIG)
        assert reasons == (None, None, "blurred", None), name


def test_pictures_far_too_dark_or_bright_are_found(stills: dict[str, Picture]) -> None:
    for name, picture in stills.items():
        dark = look_at((picture * 0.03).astype(np.uint8))
        white = look_at(np.asarray(cv2.convertScaleAbs(picture, alpha=8.0, beta=90), np.uint8))
        assert poor_images([dark, white], _CONFIG) == ("under-exposed", "over-exposed"), name


def _with_person(picture: Picture, left_px: int) -> Picture:
    changed = picture.copy()
    changed[300:400, left_px : left_px + 40] = (40, 30, 60)
    return changed


def test_a_log_with_a_stop_a_person_and_poor_frames(clip: list[Picture]) -> None:
    stand, noise = clip[60], np.random.default_rng(0)
    grainy = np.clip(stand + noise.normal(0.0, 4.0, stand.shape), 0, 255).astype(np.uint8)
    shots: list[tuple[Picture, Decision]] = [
        *((picture, Decision()) for picture in clip[:60:5]),
        (stand, Decision()),
        (grainy, Decision(dropped="duplicate", of=12)),
        (_with_person(stand, 520), Decision()),
        (_with_person(stand, 640), Decision()),
        (_encoded(stand), Decision(dropped="duplicate", of=12)),
        (clip[65], Decision()),
        (_moved(clip[70]), Decision(dropped="blurred")),
        ((clip[75] * 0.03).astype(np.uint8), Decision(dropped="under-exposed")),
        (clip[80], Decision()),
        (_brighter(clip[0]), Decision(dropped="duplicate", of=0)),
    ]
    candidates = [
        Candidate(drive="a", camera="f", stamp_ns=i, keyframe_ns=i, look=look_at(picture))
        for i, (picture, _) in enumerate(shots)
    ]
    assert decide(candidates, SelectionConfig()) == tuple(expected for _, expected in shots)
