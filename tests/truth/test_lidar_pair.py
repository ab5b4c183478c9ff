"""LiDAR pairs in rooms and streets of boxes, where the true transform is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.lidars.pair import register_pair
from percept.calib.lidars.pair_candidates import difference
from percept.calib.lidars.pair_result import PairRegistration
from percept.calib.lidars.pair_spread import solve_spread
from percept.calib.lidars.registration import Stage, apply_step, refine, surface
from percept.core.results import Verdict

_F64 = NDArray[np.float64]
_Scenes = list[tuple[_F64, _F64]]


def _pose(x: float, y: float, z: float, *rpy_deg: float) -> _F64:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


def _rays(rings: int, columns: int) -> _F64:
    elevation = np.radians(np.linspace(-28, 18, rings))[:, None]
    azimuth = np.radians(np.arange(columns) * 360 / columns)[None, :]
    flat = np.cos(elevation)
    rays = np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth], axis=-1
    )
    return rays.reshape(-1, 3)


def _scan(boxes: _F64, T_world_sensor: _F64, rays: _F64, rng: np.random.Generator) -> _F64:
    """Return where rays end on boxes (N, 2, 3), also from within one, with 1 cm noise."""
    directions = rays @ T_world_sensor[:3, :3].T
    directions = np.where(np.abs(directions) < 1e-9, 1e-9, directions)
    ranges = np.full(len(rays), np.inf)
    for low, high in boxes:
        first, second = ((side - T_world_sensor[:3, 3]) / directions for side in (low, high))
        enter = np.minimum(first, second).max(axis=1)
        leave = np.maximum(first, second).min(axis=1)
        hit = np.where(enter > 0, enter, leave)
        ranges = np.where((enter <= leave) & (hit > 0), np.minimum(ranges, hit), ranges)
    seen = ranges < 60
    noisy = ranges[seen] + rng.normal(0, 0.01, int(seen.sum()))
    points: _F64 = rays[seen] * noisy[:, None]
    return points


def _box(x: float, y: float, z: float, *size: float) -> _F64:
    half = np.array(size) / 2
    return np.stack([np.array([x, y, z]) - half, np.array([x, y, z]) + half])


_GROUND = _box(0, 0, -0.5, 400, 400, 1)


def _street(seed: int) -> _F64:
    """Ground, houses along both sides with gaps, cars and posts."""
    rng = np.random.default_rng(seed)
    boxes = [_GROUND]
    for side in (-1, 1):
        at = -45.0
        while at < 45:
            length, back = rng.uniform(5, 12), rng.uniform(0, 4)
            boxes.append(_box(at + length / 2, side * (14 + back), 3, length, 8, rng.uniform(5, 9)))
            at += length + rng.uniform(0.5, 4)
        for x in rng.uniform(-25, 25, 4):
            boxes.append(_box(x, side * rng.uniform(5, 8), 0.8, 4.3, 1.8, 1.6))
            boxes.append(_box(x + 3, side * 9, 2, 0.2, 0.2, 4))
    return np.stack(boxes)


_T_TOP = _pose(0, 0, 2, 0, 0, 0)
_MOUNTS = {
    "side, tilted": _pose(0.1, 0.6, -0.4, -4, 45, 92),
    "upside down": _pose(0.0, 0.1, -0.3, 178, 1, -11),
    "front, low": _pose(2.2, 0.2, -1.3, 1, 3, -170),
}


def _scenes(
    worlds: list[_F64], T: _F64, seed: int = 0, rings: int = 32, columns: int = 240
) -> _Scenes:
    rng = np.random.default_rng(seed)
    rays, own = _rays(rings, columns), _rays(rings // 2, columns)
    return [
        (_scan(world, _T_TOP, rays, rng), _scan(world, _T_TOP @ T, own, rng)) for world in worlds
    ]


def _room(width: float, length: float) -> _F64:
    return np.stack([_box(0, 0, 1.5, width, length, 3.6)])


_SIDE = _MOUNTS["side, tilted"]
_ROOM_MOUNT = _pose(0.3, 0.2, -0.3, 0, 0, 40)


def _is_right(found: PairRegistration, T: _F64, metres: float, degrees: float) -> bool:
    assert found.T_target_source is not None
    moved, turned = difference(found.T_target_source, T)
    return moved < metres and turned < degrees


@pytest.mark.parametrize("mount", _MOUNTS)
def test_streets_give_the_mount_without_a_guess(mount: str) -> None:
    T = _MOUNTS[mount]
    found = register_pair(_scenes([_street(0), _street(1)], T, columns=360))
    assert _is_right(found, T, 0.012, 0.03), found
    assert found.verdict in (Verdict.GOOD, Verdict.DOUBTFUL), found.why
    assert found.scenes_agreeing == (2, 2)


def test_a_wrong_guess_changes_nothing() -> None:
    scenes = _scenes([_street(0)], _SIDE)
    without = register_pair(scenes)
    guessed = register_pair(scenes, initial=_pose(1, -2, 0, 0, 0, 180))
    assert without.T_target_source is not None
    assert _is_right(guessed, without.T_target_source, 1e-3, 1e-3)
    assert guessed.verdict == without.verdict == Verdict.DOUBTFUL
    assert any("One scene only" in why for why in guessed.why)


def test_the_stated_spread_covers_the_error() -> None:
    """Errors over 30 worlds, in stated standard deviations, have a root mean square near 1."""
    stage = Stage(0.3, 0.05, 20)
    ratios = []
    for seed in range(30):
        T = list(_MOUNTS.values())[seed % 3]
        scenes = _scenes([_street(1000 + 10 * seed)], T, seed, 24, 240)
        pairs = [(surface(a, 0.1), surface(b, 0.1)) for a, b in scenes]
        found = refine(pairs, apply_step(T, np.full(6, 0.01)), [Stage(0.3, 0.1, 8), stage])
        spread = solve_spread(pairs, found, stage)
        turn = Rotation.from_matrix(found[:3, :3] @ T[:3, :3].T).as_rotvec(degrees=True)
        ratios += [turn / spread.rotation_deg, (found - T)[:3, 3] / spread.translation_m]
    pooled = np.sqrt(np.mean(np.square(ratios)))
    assert 0.7 < pooled < 1.5


@pytest.mark.parametrize(("width", "length"), [(10, 10), (10, 16)])
def test_symmetric_rooms_are_ambiguous(width: float, length: float) -> None:
    found = register_pair(_scenes([_room(width, length)] * 2, _ROOM_MOUNT, rings=24, columns=180))
    assert found.verdict is Verdict.AMBIGUOUS
    assert "places explain the scenes about equally" in found.why[0]
    assert len([why for why in found.why if "equally" in why]) == 1
    assert any(rival.close for rival in found.rivals)


def test_ranges_that_are_too_long_are_a_fault_and_not_a_place() -> None:
    """Half of the view is blocked, so that 5 cm more look much like a sensor further back."""
    T = _MOUNTS["front, low"]
    scenes = [
        (a, (b * (1 + 0.05 / np.linalg.norm(b, axis=1, keepdims=True)))[b[:, 0] > 0])
        for a, b in _scenes([_street(0), _street(1)], T)
    ]
    found = register_pair(scenes)
    assert found.verdict is Verdict.DOUBTFUL
    assert "too far, compared with the target" in found.why[0]
    assert found.range_offset_m == pytest.approx(0.05, abs=0.01)
    assert _is_right(found, T, 0.02, 0.1)


def test_beams_that_point_elsewhere_than_said_are_noticed() -> None:
    scenes = []
    for a, b in _scenes([_street(0), _street(1)], _SIDE):
        flat = np.hypot(b[:, 0], b[:, 1])
        raised = np.arctan2(b[:, 2], flat) + np.radians(1)
        ranges = np.linalg.norm(b, axis=1)
        along = (ranges * np.cos(raised) / flat)[:, None]
        scenes.append((a, np.column_stack([b[:, :2] * along, ranges * np.sin(raised)])))
    found = register_pair(scenes)
    assert found.verdict is not Verdict.GOOD
    assert any("too high" in why for why in found.why)


def test_a_corridor_names_the_direction_along_it() -> None:
    found = register_pair(
        _scenes([_room(200, 4), _room(200, 6)], _ROOM_MOUNT, rings=24, columns=180)
    )
    assert found.verdict.exit_code == 4
    assert found.weak_directions[0] == "forward x"
    assert "does not determine forward x" in found.why[0]


def test_a_plain_says_that_nothing_stands_on_it() -> None:
    found = register_pair(_scenes([np.stack([_GROUND])] * 2, _ROOM_MOUNT, rings=24, columns=180))
    assert found.verdict is Verdict.BAD
    assert {"forward x", "left y", "yaw"} <= set(" and ".join(found.weak_directions).split(" and "))


def test_clouds_of_different_places_are_bad() -> None:
    (a, _), (_, b) = _scenes([_street(0), _street(7)], _SIDE)
    assert register_pair([(a, b)]).verdict.exit_code == 4


def test_swapped_scenes_are_not_believed() -> None:
    one, two = _scenes([_street(0), _street(7)], _SIDE)
    assert register_pair([(one[0], two[1]), (two[0], one[1])]).verdict.exit_code == 4


def test_a_sensor_that_moved_between_scenes_is_noticed() -> None:
    still = _scenes([_street(1), _street(2)], _SIDE)
    moved = _scenes([_street(3)], _pose(0, 0, 0, 0, 0, 1) @ _SIDE)
    found = register_pair(still + moved)
    assert found.verdict is Verdict.BAD
    assert found.why[0].startswith("Scene 3:")


def test_bad_clouds_are_left_out_and_named() -> None:
    a, b = _scenes([_street(0)], _SIDE)[0]
    holes = b.copy()
    holes[::10] = np.nan
    nothing = np.full((900, 3), np.nan)
    found = register_pair([(a, holes), (a, nothing), (np.empty((0, 3)), b), (a, b[:20])])
    assert _is_right(found, _SIDE, 0.03, 0.1)
    assert found.verdict is Verdict.DOUBTFUL
    assert set(found.scenes_left_out) == {1, 2, 3}
    assert found.dropped_points["not finite"] >= 900 + len(b) // 10
    assert found.scene_T_target_source[1:] == (None, None, None)


def test_nothing_usable_gives_no_transform() -> None:
    found = register_pair([(np.empty((0, 3)), np.empty((0, 3)))])
    assert found.T_target_source is None
    assert found.verdict is Verdict.BAD
    assert "no usable point" in found.why[0]
