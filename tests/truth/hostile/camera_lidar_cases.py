"""Boards before a camera and a LiDAR that invite a wrong transform."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from hostile.case import ERROR, NEVER_GOOD, RIGHT_OR_NOT_GOOD, UNUSABLE, Case, Outcome
from hostile.plates import PLATE_M, Setting, calibrated, intrinsics, pairs, with_clouds_of

from percept.calib.boards.definitions import Checkerboard
from percept.calib.camera_lidar.calibrate import BoardPair

__all__ = ["CAMERA_LIDAR_CASES"]

CAMERA_LIDAR_CASES: list[Case] = []
_SOUND = Setting()


def _case(
    name: str, wrong: str, allowed: frozenset[str]
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    def add(run: Callable[[], Outcome]) -> Callable[[], Outcome]:
        CAMERA_LIDAR_CASES.append(Case("camera-lidar", name, wrong, run, allowed))
        return run

    return add


def _mirrored(pair: BoardPair) -> BoardPair:
    assert pair.view is not None
    flipped = pair.view.corners_px * [-1, 1] + [pair.view.image_size[0] - 1, 0]
    return replace(pair, view=replace(pair.view, corners_px=flipped))


# ---- files that do not belong together


@_case("two pairs swapped", "two clouds are in each other's place", RIGHT_OR_NOT_GOOD)
def _two_swapped() -> Outcome:
    return calibrated(with_clouds_of(pairs(_SOUND), [0, 1, 7, 3, 4, 5, 6, 2, 8, 9, 10, 11]))


@_case("pairs shifted by one", "each image has the cloud of the next", UNUSABLE)
def _shifted() -> Outcome:
    return calibrated(with_clouds_of(pairs(_SOUND), [*range(1, 12), 0]))


@_case("pairs shuffled", "clouds in no order", UNUSABLE)
def _shuffled() -> Outcome:
    order = np.random.default_rng(0).permutation(12)
    return calibrated(with_clouds_of(pairs(_SOUND), order.tolist()))


@_case("half of the pairs swapped", "six of twelve clouds belong to other images",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _half_swapped() -> Outcome:
    return calibrated(with_clouds_of(pairs(_SOUND), [1, 0, 3, 2, 5, 4, 6, 7, 8, 9, 10, 11]))


# ---- poses that do not determine the transform


@_case("one pair", "a single image and cloud", UNUSABLE)
def _one() -> Outcome:
    return calibrated(pairs(_SOUND)[:1])


@_case("four pairs", "too few for halves to be compared", NEVER_GOOD)
def _four() -> Outcome:
    return calibrated(pairs(_SOUND)[:4])


@_case("boards all facing one way", "none is tilted by more than 2 deg", NEVER_GOOD)
def _one_way() -> Outcome:
    return calibrated(pairs(Setting(seed=1, tilt_deg=2.0)))


@_case("board never moved", "twelve times the same pose", NEVER_GOOD)
def _still() -> Outcome:
    return calibrated(pairs(Setting(seed=2, still=True)))


@_case("one pair ten times", "the same two files again and again", UNUSABLE)
def _repeated() -> Outcome:
    one = pairs(_SOUND)[0]
    return calibrated([replace(one, name=f"{one.name}-{k}") for k in range(10)])


# ---- sizes and intrinsics that are not what they are said to be


@_case("wrong square size", "95 mm given, 100 mm printed", NEVER_GOOD)
def _square() -> Outcome:
    return calibrated(pairs(_SOUND), board=Checkerboard(7, 5, 0.095))


@_case("columns and rows swapped", "5x7 corners given, 7x5 printed", UNUSABLE)
def _swapped_board() -> Outcome:
    return calibrated(pairs(_SOUND), board=Checkerboard(5, 7, 0.1), plate_m=(0.9, 0.81))


@_case("width and height of the plate swapped", "0.7 x 0.9 m given, 0.9 x 0.7 m is right",
       frozenset({ERROR}))  # fmt: skip
def _swapped_plate() -> Outcome:
    return calibrated(pairs(_SOUND), plate_m=(PLATE_M[1], PLATE_M[0]))


@_case("wrong plate size", "1.1 x 0.9 m given, 0.9 x 0.7 m is right", NEVER_GOOD)
def _plate() -> Outcome:
    wrong = (1.1, 0.9)
    return calibrated(pairs(Setting(given_m=wrong)), plate_m=wrong)


@_case("plate size a little wrong", "0.93 x 0.73 m given, 0.9 x 0.7 m is right",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _plate_a_little() -> Outcome:
    wrong = (0.93, 0.73)
    return calibrated(pairs(Setting(given_m=wrong)), plate_m=wrong)


@_case("wrong focal length", "intrinsics with f 5 % too long", NEVER_GOOD)
def _focal() -> Outcome:
    return calibrated(pairs(_SOUND), camera=intrinsics(1.05))


@_case("wrong principal point", "intrinsics with cx 30 px to the right", NEVER_GOOD)
def _centre() -> Outcome:
    return calibrated(pairs(_SOUND), camera=intrinsics(right_px=30))


@_case("mirrored images", "every image is flipped left to right", UNUSABLE)
def _mirrored_images() -> Outcome:
    return calibrated([_mirrored(pair) for pair in pairs(_SOUND)], None)


@_case("one image mirrored", "one of twelve is flipped left to right", RIGHT_OR_NOT_GOOD)
def _one_mirrored() -> Outcome:
    sound = pairs(_SOUND)
    return calibrated([*sound[:5], _mirrored(sound[5]), *sound[6:]])


@_case("plate turned, and the pattern fits", "0.7 x 0.9 m given for a small pattern on 0.9 x 0.7 m",
       NEVER_GOOD)  # fmt: skip
def _turned_plate() -> Outcome:
    small, turned = Checkerboard(7, 5, 0.08), (PLATE_M[1], PLATE_M[0])
    given = pairs(Setting(seed=8, given_m=turned, square_m=0.08))
    return calibrated(given, board=small, plate_m=turned)


@_case("pattern off centre", "printed 2 cm beside the middle of its plate", RIGHT_OR_NOT_GOOD)
def _off_centre() -> Outcome:
    return calibrated(pairs(Setting(seed=9, off_centre_m=0.02)))


@_case("pattern off centre, upright", "the same, and the board was never turned in the image",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _off_centre_upright() -> Outcome:
    return calibrated(pairs(Setting(seed=9, off_centre_m=0.02, roll_deg=3.0)))


@_case("intrinsics of another size", "those of images of half the size", UNUSABLE)
def _half_size() -> Outcome:
    return calibrated(pairs(_SOUND), camera=intrinsics(0.5, right_px=-480))


# ---- the world and the LiDAR


@_case("board in the hand", "it moves by some 3 cm between image and cloud", RIGHT_OR_NOT_GOOD)
def _hand() -> Outcome:
    return calibrated(pairs(Setting(seed=10, shake_m=0.03)))


@_case("LiDAR moved half way", "by 5 cm and 1 deg after six of twelve poses", NEVER_GOOD)
def _moved() -> Outcome:
    return calibrated(pairs(Setting(seed=3, moves_at=6)))


@_case("LiDAR moved near the end", "by 5 cm and 1 deg before the last two of twelve poses",
       NEVER_GOOD)  # fmt: skip
def _moved_late() -> Outcome:
    return calibrated(pairs(Setting(seed=3, moves_at=10)))


@_case("square plate", "quarters of a turn look the same to the LiDAR", RIGHT_OR_NOT_GOOD)
def _square_plate() -> Outcome:
    size = (0.9, 0.9)
    return calibrated(pairs(Setting(seed=4, plate_m=size, given_m=size)), plate_m=size)


@_case("no board in the clouds", "the LiDAR looks elsewhere", UNUSABLE)
def _no_board() -> Outcome:
    return calibrated(pairs(Setting(count=6, board=False)))


@_case("second panel", "another plate of the same size moves through the view", RIGHT_OR_NOT_GOOD)
def _panel() -> Outcome:
    return calibrated(pairs(Setting(seed=5, panel=True)))


@_case("LiDAR upside down", "mounted with its top below", RIGHT_OR_NOT_GOOD)
def _upside_down() -> Outcome:
    setting = Setting(seed=6, upside_down=True)
    return calibrated(pairs(setting), setting.truth())


@_case("ranges too long", "the LiDAR measures 3 cm too far", RIGHT_OR_NOT_GOOD)
def _bias() -> Outcome:
    return calibrated(pairs(Setting(seed=7, bias_m=0.03)))


@_case("another board's clouds", "the LiDAR's files are of another recording", UNUSABLE)
def _another_recording() -> Outcome:
    other = pairs(Setting(seed=3, moves_at=6))
    return calibrated(
        [replace(pair, board=o.board) for pair, o in zip(pairs(_SOUND), other, strict=True)], None
    )
