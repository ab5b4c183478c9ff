"""Views of boards that invite a wrong camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from hostile.camera_views import BOARD, CAMERA, SIZE, calibrated, drawn, from_images, lens, views
from hostile.case import NEVER_GOOD, RIGHT_OR_NOT_GOOD, UNUSABLE, Case, Outcome
from numpy.typing import NDArray

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.views import BoardView
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig
from percept.core.cameras import make_camera

__all__ = ["CAMERA_CASES"]

_F64 = NDArray[np.float64]
CAMERA_CASES: list[Case] = []


def _case(
    name: str, wrong: str, allowed: frozenset[str]
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    def add(run: Callable[[], Outcome]) -> Callable[[], Outcome]:
        CAMERA_CASES.append(Case("camera", name, wrong, run, allowed))
        return run

    return add


def _changed(
    given: list[BoardView], which: slice, change: Callable[[_F64], _F64]
) -> list[BoardView]:
    rows = set(range(len(given))[which])
    return [
        replace(view, corners_px=change(view.corners_px)) if k in rows else view
        for k, view in enumerate(given)
    ]


def _mirror(corners: _F64) -> _F64:
    return corners * [-1, 1] + [SIZE[0] - 1, 0]


# ---- the board is not what it is said to be


@_case("wrong square size", "30 mm given, 60 mm printed; the camera does not depend on it",
       frozenset({"good"}))  # fmt: skip
def _square() -> Outcome:
    return calibrated(views(), board=Checkerboard(8, 5, 0.03))


@_case("columns and rows swapped", "images of 8x5 corners, 5x8 given", RIGHT_OR_NOT_GOOD)
def _swapped() -> Outcome:
    return from_images(drawn(), Checkerboard(5, 8, 0.06))


@_case("columns and rows swapped in corners", "corners in the order of another board", UNUSABLE)
def _swapped_corners() -> Outcome:
    return calibrated(views(), board=Checkerboard(5, 8, 0.06))


@_case("squares counted, not corners", "images of 8x5 corners, 9x6 given", UNUSABLE)
def _squares() -> Outcome:
    return from_images(drawn(count=2), Checkerboard(9, 6, 0.06), None)


@_case("a part of the board", "images of 8x5 corners, 6x3 given", UNUSABLE)
def _part() -> Outcome:
    return from_images(drawn(count=2), Checkerboard(6, 3, 0.06), None)


@_case("stretched print", "the printer made columns 1 % longer than rows", NEVER_GOOD)
def _stretched() -> Outcome:
    return calibrated(views(stretch=(1.01, 1.0)))


@_case("stretched print, upright", "the same, and the board was never turned in the image",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _stretched_upright() -> Outcome:
    return calibrated(views(count=24, stretch=(1.01, 1.0), roll_rad=0.01))


@_case("bent board", "the middle stands out by 3 mm", NEVER_GOOD)
def _bent() -> Outcome:
    return calibrated(views(bend_m=0.003))


# ---- poses that do not determine a camera


@_case("one view", "a single image", UNUSABLE)
def _one() -> Outcome:
    return calibrated(views(count=1))


@_case("two views", "two images", UNUSABLE)
def _two() -> Outcome:
    return calibrated(views(count=2))


@_case("all frontal", "every board is parallel to the image", NEVER_GOOD)
def _frontal() -> Outcome:
    return calibrated(views(tilt_deg=(0, 2)))


@_case("one pose", "the board never moved", UNUSABLE)
def _one_pose() -> Outcome:
    rng = np.random.default_rng(5)
    view = views(count=1)[0]
    return calibrated(
        [
            replace(view, name=f"v{k}", corners_px=view.corners_px + rng.normal(0, 0.1, (40, 2)))
            for k in range(15)
        ]
    )


@_case("duplicates", "four images, each ten times", NEVER_GOOD)
def _duplicates() -> Outcome:
    four = views(count=4)
    return calibrated([replace(v, name=f"{v.name}-{k}") for k in range(10) for v in four])


@_case("no board low in the image", "only the upper half is covered", UNUSABLE)
def _upper_half() -> Outcome:
    return calibrated(views(rows=(0.0, 0.55)))


@_case("tiny boards far away", "no board is wider than 8 % of the image", NEVER_GOOD)
def _tiny() -> Outcome:
    return calibrated(views(width=(0.04, 0.08)))


# ---- images and corners that are spoilt


@_case("no board", "images of something else", UNUSABLE)
def _no_board() -> Outcome:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (3, 100, 160), dtype=np.uint8)
    return from_images([np.asarray(cv2.resize(n, SIZE), np.uint8) for n in noise], truth=None)


@_case("board partly out of view", "every board is cut off by the image's edge", UNUSABLE)
def _cut() -> Outcome:
    return from_images(drawn(count=2, sink=0.6), truth=None)


@_case("blurred", "all images are far out of focus", RIGHT_OR_NOT_GOOD)
def _blurred() -> Outcome:
    soft = [cv2.GaussianBlur(image, (0, 0), 8) for image in drawn()]
    return from_images([np.asarray(image, np.uint8) for image in soft])


@_case("some blurred", "every third image is smeared along its rows", RIGHT_OR_NOT_GOOD)
def _smeared() -> Outcome:
    smear = np.ones((1, 15), np.float32) / 15
    images = drawn(count=18)
    images[::3] = [np.asarray(cv2.filter2D(i, -1, smear), np.uint8) for i in images[::3]]
    return from_images(images)


@_case("one image mirrored", "one of 16 is flipped left to right", RIGHT_OR_NOT_GOOD)
def _one_mirrored() -> Outcome:
    return calibrated(_changed(views(), slice(7, 8), _mirror))


@_case("all images mirrored", "every image is flipped; the camera of such images is right",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _all_mirrored() -> Outcome:
    K = CAMERA.K.copy()
    K[0, 2] = SIZE[0] - 1 - K[0, 2]
    mirrored = make_camera("pinhole", SIZE, K, CAMERA.distortion * [1, 1, 1, -1, 1])
    return calibrated(_changed(views(), slice(None), _mirror), mirrored)


@_case("image sizes mixed", "a third of the images are scaled to half", RIGHT_OR_NOT_GOOD)
def _sizes() -> Outcome:
    half = (SIZE[0] // 2, SIZE[1] // 2)
    given = _changed(views(), slice(0, None, 3), lambda corners: corners / 2 - 0.25)
    return calibrated(
        [replace(v, image_size=half) if k % 3 == 0 else v for k, v in enumerate(given)]
    )


@_case("scaled without a word", "a third of the images show the middle, enlarged by 2 %",
       NEVER_GOOD)  # fmt: skip
def _enlarged() -> Outcome:
    middle = np.array(SIZE) / 2
    given = _changed(views(), slice(0, None, 3), lambda c: middle + 1.02 * (c - middle))
    return calibrated([v for v in given if (v.corners_px > 0).all()])


@_case("zoom moved half way", "the focal length is 1 % longer in the second half", NEVER_GOOD)
def _zoom() -> Outcome:
    later = [replace(v, name=f"w{v.name}") for v in views(lens(909.0), 1, count=8)]
    return calibrated([*views(count=8), *later])


@_case("another camera's images", "a third of the views are of a lens with f 7 % longer",
       NEVER_GOOD)  # fmt: skip
def _other_camera() -> Outcome:
    other = [replace(v, name=f"o{v.name}") for v in views(lens(963.0, right_px=30), 1, count=5)]
    return calibrated([*views(count=11), *other])


@_case("image stabiliser", "each image is shifted by some 8 px", RIGHT_OR_NOT_GOOD)
def _stabiliser() -> Outcome:
    rng = np.random.default_rng(2)
    return calibrated(_changed(views(), slice(None), lambda c: c + rng.normal(0, 8, 2)))


@_case("rolling shutter", "the board moves while the rows are read: sheared by some 1 %",
       NEVER_GOOD)  # fmt: skip
def _shutter() -> Outcome:
    rng = np.random.default_rng(3)

    def sheared(corners: _F64) -> _F64:
        return corners + corners[:, 1:] * rng.normal(0, 0.01, 2)

    return calibrated(_changed(views(), slice(None), sheared))


@_case("corner order broken in one view", "its corners are listed by columns", RIGHT_OR_NOT_GOOD)
def _permuted() -> Outcome:
    order = np.arange(40).reshape(5, 8).T.ravel()
    return calibrated(_changed(views(), slice(4, 5), lambda corners: corners[order]))


@_case("outlier corners", "one corner in twenty is up to 20 px off", RIGHT_OR_NOT_GOOD)
def _outliers() -> Outcome:
    rng = np.random.default_rng(4)

    def spoilt(corners: _F64) -> _F64:
        off = rng.random(len(corners)) < 0.05
        return corners + off[:, None] * rng.uniform(-20, 20, corners.shape)

    return calibrated(_changed(views(), slice(None), spoilt))


@_case("noise instead of corners", "the corners are anywhere", UNUSABLE)
def _noise() -> Outcome:
    rng = np.random.default_rng(5)
    anywhere = _changed(views(count=12), slice(None), lambda c: rng.uniform((0, 0), SIZE, c.shape))
    return calibrated(anywhere, None)


@_case("huge noise", "corners are known to 3 px only", NEVER_GOOD)
def _huge_noise() -> Outcome:
    return calibrated(views(noise_px=3.0))


@_case("fisheye as pinhole", "a lens of 150 deg, and `--model pinhole`", NEVER_GOOD)
def _fisheye() -> Outcome:
    truth = lens(480.0, "fisheye")
    return calibrated(views(truth), truth, BOARD, CameraCalibrationConfig(model="pinhole"))


@_case("half of the views elsewhere", "every second view shows noise", RIGHT_OR_NOT_GOOD)
def _half_noise() -> Outcome:
    rng = np.random.default_rng(6)
    given = _changed(views(), slice(0, None, 2), lambda c: rng.uniform((0, 0), SIZE, c.shape))
    return calibrated(given, CAMERA)
