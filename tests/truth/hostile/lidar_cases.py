"""LiDARs in worlds, and with files, that invite a wrong answer."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from hostile.case import ERROR, NEVER_GOOD, RIGHT_OR_NOT_GOOD, UNUSABLE, Case, Outcome, pose
from hostile.lidar_worlds import (
    GROUND,
    SIDE,
    TOP,
    box,
    calibrated,
    capture,
    corridor,
    pillars,
    rays,
    room,
    street,
)
from numpy.typing import NDArray

__all__ = ["LIDAR_CASES"]

_F64 = NDArray[np.float64]
_Scenes = list[dict[str, _F64]]

_LEVEL = pose(0.3, 0.4, -0.3, 0, 0, 40)
_UPSIDE_DOWN = pose(0.1, 0.1, -0.3, 178, 1, -11)
_PLACES = (pose(0.6, 0.3, 2, 0, 0, 5), pose(-0.7, -0.5, 2, 0, 0, -20))
LIDAR_CASES: list[Case] = []


def _case(
    name: str, wrong: str, allowed: frozenset[str]
) -> Callable[[Callable[[], Outcome]], Callable[[], Outcome]]:
    def add(run: Callable[[], Outcome]) -> Callable[[], Outcome]:
        LIDAR_CASES.append(Case("lidar", name, wrong, run, allowed))
        return run

    return add


def _streets(count: int = 2) -> list[_F64]:
    return [street(seed) for seed in range(count)]


@cache
def _sound() -> _Scenes:
    return capture(_streets())


def _with(scenes: _Scenes, name: str, change: Callable[[_F64], _F64]) -> _Scenes:
    return [{**scene, name: change(scene[name])} for scene in scenes]


# ---- places that look alike from several poses


@_case("square room", "four turns of the sensor explain what it sees", UNUSABLE)
def _square_room() -> Outcome:
    return calibrated(capture([room(10, 10)] * 2, _LEVEL, T_world_top=_PLACES), _LEVEL)


@_case("rectangular room", "half a turn explains what it sees", UNUSABLE)
def _rectangular_room() -> Outcome:
    return calibrated(capture([room(16, 9)] * 2, _LEVEL, T_world_top=_PLACES), _LEVEL)


@_case("two rooms of other sizes", "half a turn explains each of them", RIGHT_OR_NOT_GOOD)
def _two_rooms() -> Outcome:
    return calibrated(capture([room(16, 9), room(12, 8)], _LEVEL, T_world_top=_PLACES), _LEVEL)


@_case("room with one box", "a single box tells the ends of a room apart", RIGHT_OR_NOT_GOOD)
def _room_with_a_box() -> Outcome:
    worlds = [room(16, 9, box(6, 3, 0.5, 1, 1, 1)), room(16, 9, box(-6, 2, 0.5, 1, 1, 1))]
    return calibrated(capture(worlds, _LEVEL, T_world_top=_PLACES), _LEVEL)


@_case("corridor", "nothing tells where along it the sensors are", UNUSABLE)
def _corridor() -> Outcome:
    return calibrated(capture([corridor(4), corridor(6)], _LEVEL), _LEVEL)


@_case("open field", "only the ground is seen", UNUSABLE)
def _field() -> Outcome:
    return calibrated(capture([np.stack([GROUND])] * 2, _LEVEL), _LEVEL)


@_case("grid of pillars", "a step of one pillar looks the same", NEVER_GOOD)
def _pillars() -> Outcome:
    return calibrated(capture([pillars(3.0)] * 2, _LEVEL, T_world_top=_PLACES), _LEVEL)


@_case("ring of posts", "an eighth of a turn looks the same", NEVER_GOOD)
def _ring() -> Outcome:
    angles = np.arange(8) * np.pi / 4
    posts = [box(12 * np.cos(a), 12 * np.sin(a), 2, 0.3, 0.3, 4) for a in angles]
    mount = pose(0.1, 0.0, -0.3, 0, 0, 40)
    return calibrated(capture([np.stack([GROUND, *posts])] * 2, mount), mount)


# ---- too little, or nothing, that both see


@_case("other places", "the sensors were in different streets", UNUSABLE)
def _other_places() -> Outcome:
    here, there = capture(_streets()), capture([street(7), street(8)], seed=1)
    scenes = [{"top": a["top"], "side": b["side"]} for a, b in zip(here, there, strict=True)]
    return calibrated(scenes, None)


@_case("opposite views", "one looks ahead, one back, and 20 deg are shared", RIGHT_OR_NOT_GOOD)
def _opposite() -> Outcome:
    ahead, back = (rays(24, 150, azimuth_deg=around) for around in ((-95, 95), (85, 275)))
    mount = pose(-0.5, 0.1, 0, 0, 0, 3)
    return calibrated(capture(_streets(), mount, top_rays=ahead, side_rays=back), mount)


@_case("one scene", "whether scenes agree cannot be tested", NEVER_GOOD)
def _one_scene() -> Outcome:
    return calibrated(capture(_streets(1)), SIDE)


@_case("one scene twice", "the same files were given again", NEVER_GOOD)
def _scene_twice() -> Outcome:
    return calibrated(capture(_streets(1)) * 2, SIDE)


@_case("one place twice", "the vehicle did not move between two scenes", NEVER_GOOD)
def _place_twice() -> Outcome:
    return calibrated(capture(_streets(1)) + capture(_streets(1), seed=9), SIDE)


@_case("four beams", "the side LiDAR has four beams only", RIGHT_OR_NOT_GOOD)
def _four_beams() -> Outcome:
    few = rays(4, 240, elevation_deg=(-8, 4))
    return calibrated(capture(_streets(), side_rays=few), SIDE)


# ---- broken clouds


@_case("only NaN", "one LiDAR's clouds have no number in them", UNUSABLE)
def _nan_only() -> Outcome:
    return calibrated(_with(_sound(), "side", lambda p: p * np.nan), None)


@_case("empty clouds", "one LiDAR's clouds have no point", UNUSABLE)
def _empty() -> Outcome:
    return calibrated(_with(_sound(), "side", lambda p: p[:0]), None)


@_case("half NaN", "every second point of one LiDAR is not a number", RIGHT_OR_NOT_GOOD)
def _half_nan() -> Outcome:
    def holes(points: _F64) -> _F64:
        return np.where(np.arange(len(points))[:, None] % 2, points, np.nan)

    return calibrated(_with(_sound(), "side", holes), SIDE)


@_case("rain", "a third of the points float in the air", RIGHT_OR_NOT_GOOD)
def _rain() -> Outcome:
    rng = np.random.default_rng(0)

    def wet(points: _F64) -> _F64:
        hit = rng.random(len(points)) < 0.33
        return np.where(hit[:, None], points * rng.uniform(0.1, 1, (len(points), 1)), points)

    scenes = _with(_with(_sound(), "side", wet), "top", wet)
    return calibrated(scenes, SIDE)


@_case("millimetres", "one LiDAR's clouds are in millimetres", UNUSABLE)
def _millimetres() -> Outcome:
    return calibrated(_with(_sound(), "side", lambda p: 1000 * p), None)


@_case("wrong unit by little", "one LiDAR's clouds are 3 % too large", NEVER_GOOD)
def _three_percent() -> Outcome:
    return calibrated(_with(_sound(), "side", lambda p: 1.03 * p), SIDE)


@_case("mirrored clouds", "y of one LiDAR has the wrong sign", UNUSABLE)
def _mirrored() -> Outcome:
    return calibrated(_with(_sound(), "side", lambda p: p * [1, -1, 1]), None)


@_case(
    "clouds in the vehicle's frame",
    "the side LiDAR's points were moved into the vehicle's frame",
    RIGHT_OR_NOT_GOOD,
)
def _vehicle_frame() -> Outcome:
    T_base_side = TOP @ SIDE

    def moved(points: _F64) -> _F64:
        return points @ T_base_side[:3, :3].T + T_base_side[:3, 3]

    return calibrated(_with(_sound(), "side", moved), pose(0, 0, -2))


@_case("ranges too long", "one LiDAR, half of whose view is blocked, measures 5 cm too far",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _range_bias() -> Outcome:
    half = rays(16, 150, azimuth_deg=(-90, 90))
    return calibrated(capture(_streets(), side_rays=half, side_bias_m=0.05), SIDE)


@_case("wrong beam angles", "one LiDAR's beams are said to be 1 deg higher than they are",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _beam_angles() -> Outcome:
    def raised(points: _F64) -> _F64:
        flat = np.hypot(points[:, 0], points[:, 1])
        elevation = np.arctan2(points[:, 2], flat) + np.radians(1)
        ranges = np.linalg.norm(points, axis=1)
        along = ranges * np.cos(elevation) / flat
        return np.column_stack([points[:, :2] * along[:, None], ranges * np.sin(elevation)])

    return calibrated(_with(_sound(), "side", raised), SIDE)


# ---- files and sensors that are not what they are said to be


@_case("one LiDAR upside down", "mounted with its top below", frozenset({"good"}))
def _upside_down() -> Outcome:
    return calibrated(capture(_streets(), _UPSIDE_DOWN), _UPSIDE_DOWN)


@_case("one cloud for both", "the same files were given for two sensors", frozenset({ERROR}))
def _same_cloud() -> Outcome:
    return calibrated([{"top": s["top"], "side": s["top"]} for s in _sound()], None)


@_case("scenes exchanged", "the side LiDAR's two files are in the wrong order", UNUSABLE)
def _scenes_exchanged() -> Outcome:
    one, two = _sound()
    return calibrated(
        [{"top": one["top"], "side": two["side"]}, {"top": two["top"], "side": one["side"]}], None
    )


@_case("one file of another place", "the side LiDAR's third file belongs elsewhere",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _one_stranger() -> Outcome:
    scenes = capture(_streets(3))
    scenes[2]["side"] = capture([street(9)], seed=4)[0]["side"]
    return calibrated(scenes, SIDE)


@_case("names exchanged in one scene", "top and side files are swapped in the second scene",
       NEVER_GOOD)  # fmt: skip
def _names_in_one_scene() -> Outcome:
    one, two = _sound()
    return calibrated([one, {"top": two["side"], "side": two["top"]}], SIDE)


@_case("names exchanged", "left and right have each other's files; the given rig tells",
       NEVER_GOOD)  # fmt: skip
def _names() -> Outcome:
    right = pose(0.1, -0.6, -0.4, 4, 20, -92)
    one, two = _sound(), capture(_streets(), right, seed=5)
    scenes = [
        {"top": a["top"], "left": b["side"], "right": a["side"]}
        for a, b in zip(one, two, strict=True)
    ]
    # What the files say is right for their names; only the given rig can tell.
    return calibrated(scenes, {"left": right, "right": SIDE}, {"left": SIDE, "right": right})


@_case("sensor moved a little", "the side LiDAR moved by 1 deg and 5 cm before the last scene",
       NEVER_GOOD)  # fmt: skip
def _moved() -> Outcome:
    moved = pose(0.05, 0, 0, 0, 0, 1) @ SIDE
    return calibrated(capture(_streets(3), [SIDE, SIDE, moved]), SIDE)


@_case("scans at other times", "the vehicle went on by up to 1 m between the two scans",
       NEVER_GOOD)  # fmt: skip
def _times() -> Outcome:
    went_on = [pose(1.0, 0, 0), pose(0.4, 0, 0), pose(0, 0, 0)]
    return calibrated(capture(_streets(3), T_world_side_extra=went_on), SIDE)


@_case("wrong guess", "the given rig is off by 45 deg, half a turn and 1 m", frozenset({"good"}))
def _wrong_guess() -> Outcome:
    guess = pose(0.7, -0.7, 0, 0, 45, 180) @ SIDE
    return calibrated(_sound(), SIDE, {"side": guess})


@_case("truck alongside", "a truck that drives on between the scans fills half of the view",
       RIGHT_OR_NOT_GOOD)  # fmt: skip
def _truck() -> Outcome:
    half = rays(16, 150, azimuth_deg=(-90, 90))
    scenes = []
    for seed in range(2):
        before, after = (
            np.concatenate([street(seed), [box(x, 4.0, 2.0, 12, 2.5, 3.6)]]) for x in (0.0, 0.8)
        )
        top, side = (capture([world], seed=seed, side_rays=half)[0] for world in (before, after))
        scenes.append({"top": top["top"], "side": side["side"]})
    return calibrated(scenes, SIDE)
