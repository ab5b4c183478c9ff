"""Lights of the map against the boxes of a drive: which is gone, which is new."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.map_findings import Kind
from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.sight_lines import is_hidden
from percept.core.transform import Transform
from percept.hdmap.light import MapLight
from percept.lights.map_check import LightCheckConfig, LightFindings, LightMapChecker

_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _camera() -> CameraSensor:
    matrix = np.eye(4)
    matrix[:3, :3] = _R_BODY_OPTICAL
    matrix[:3, 3] = 1.5, 0.0, 1.6
    place = Transform("base_link", "cam", matrix)
    return CameraSensor(
        "cam", "/cam", "cam", (1280, 800), "pinhole", (800, 800, 639.5, 399.5), (0.0,) * 5, place
    )


def _light(light_id: int, x: float, y: float, z: float = 5.0, towards: float = -1.0) -> MapLight:
    """A light whose face looks along x: towards = -1 faces a vehicle that comes along +x."""
    side = -towards * 0.18
    corners = np.array(
        [[x, y + side, z], [x, y - side, z], [x, y - side, z + 1], [x, y + side, z + 1]]
    )
    return MapLight(light_id=light_id, corners_map=corners, facing=np.array([towards, 0.0, 0.0]))


def _pose(x: float) -> Transform:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return Transform("map", "base_link", matrix)


def _seen(lights: Sequence[MapLight], x: float, rng: np.random.Generator) -> Detections2D:
    """The boxes that a network would put around lights, a pixel off."""
    camera = _camera()
    assert camera.T_base_sensor is not None
    T_cam_map = (_pose(x) @ camera.T_base_sensor).inverse()
    boxes = []
    for light in lights:
        pixels, inside = camera.camera().project(T_cam_map.apply(light.corners_map))
        if inside.all():
            box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]) + 0.5
            boxes.append(box + rng.normal(0, 0.7, 4))
    return Detections2D(
        stamp_ns=int(x * 1e8),
        camera="cam",
        boxes_px=np.array(boxes).reshape(-1, 4),
        labels=("light_red",) * len(boxes),
        confidences=np.full(len(boxes), 0.8),
    )


def _drive(
    on_map: Sequence[MapLight],
    on_road: Sequence[MapLight],
    *,
    chosen: bool = True,
    drives: int = 1,
    hiding: NDArray[np.float64] | None = None,
) -> LightFindings:
    rng = np.random.default_rng(1)
    checker = LightMapChecker(on_map, chosen=chosen)
    for _ in range(drives):
        checker.begin_drive()
        for x in np.arange(0.0, 45.0, 1.5):
            checker.push(_seen(on_road, float(x), rng), _camera(), _pose(float(x)), hiding)
    return checker.finish()


_PAIR = (_light(1, 55.0, -1.0), _light(2, 55.0, 2.0))


def test_a_road_that_is_as_the_map_says_gives_no_finding() -> None:
    found = _drive(_PAIR, _PAIR)
    assert found.discrepancies == ()
    assert found.recall == 1.0
    assert all(looks >= 10 for looks in found.looks.values())


def test_a_light_that_is_gone_is_missing_on_the_road() -> None:
    (finding,) = _drive(_PAIR, _PAIR[:1]).discrepancies
    assert finding.kind is Kind.TRAFFIC_LIGHT_MISSING
    assert finding.map_element_id == 2
    assert finding.confidence > 0.9
    assert finding.looks[0].sensor == "cam"


def test_a_light_that_the_map_lacks_is_placed_by_its_rays() -> None:
    (finding,) = _drive(_PAIR[:1], _PAIR).discrepancies
    assert finding.kind is Kind.TRAFFIC_LIGHT_MISSING_IN_MAP
    assert finding.map_element_id == 0
    off = finding.points_map.mean(axis=0) - _PAIR[1].corners_map.mean(axis=0)
    assert np.linalg.norm(off) < 0.5
    assert np.linalg.norm(off) < 4 * finding.sd_m


def test_a_light_with_two_boxes_is_one_light() -> None:
    rng = np.random.default_rng(2)
    checker = LightMapChecker(_PAIR[:1])
    checker.begin_drive()
    for x in np.arange(0.0, 45.0, 1.5):
        seen = _seen(_PAIR, float(x), rng)
        twice = Detections2D(
            stamp_ns=seen.stamp_ns,
            camera=seen.camera,
            boxes_px=np.vstack([seen.boxes_px, seen.boxes_px + np.array([1.0, 3.0, 1.0, 3.0])]),
            labels=seen.labels + ("light_off",) * len(seen),
            confidences=np.tile(seen.confidences, 2),
        )
        checker.push(twice, _camera(), _pose(float(x)))
    (finding,) = checker.finish().discrepancies
    assert finding.kind is Kind.TRAFFIC_LIGHT_MISSING_IN_MAP


def test_two_drives_make_one_finding_of_two_visits() -> None:
    (finding,) = _drive(_PAIR[:1], _PAIR, drives=2).discrepancies
    assert finding.visits == 2


def test_a_light_of_the_map_that_faces_away_is_not_a_new_one() -> None:
    away = _light(3, 40.0, -6.0, towards=1.0)
    found = _drive((*_PAIR, away), (*_PAIR, _light(3, 40.0, -6.0)))
    assert found.discrepancies == ()
    assert found.looks[3] == 0


def test_low_boxes_are_no_lights() -> None:
    found = _drive(_PAIR, (*_PAIR, _light(9, 50.0, -4.0, z=0.5)))
    assert found.discrepancies == ()
    assert found.dropped["boxes of lights that hang no higher than vehicles do"] == 1


def test_what_a_truck_hides_is_not_missing() -> None:
    # A wall before the camera all the way, in the vehicle's frame.
    wall = np.array([[6.0, 0.0, 3.0, 1.0, 30.0, 6.0, 0.0]])
    found = _drive(_PAIR, (), hiding=wall)
    assert found.discrepancies == ()
    assert found.looks == {1: 0, 2: 0}


def test_a_network_that_nobody_chose_has_to_know_the_lights_of_the_map() -> None:
    found = _drive((*_PAIR, _light(3, 55.0, 5.0)), (_light(7, 55.0, -4.0),), chosen=False)
    assert found.discrepancies == ()
    assert "--model" in found.notes[0]


def test_a_network_without_any_light_says_nothing() -> None:
    found = _drive(_PAIR, ())
    assert found.discrepancies == ()
    assert "found none" in found.notes[0]


@pytest.mark.parametrize(("hits", "gone"), [(2, True), (6, False)])
def test_a_light_that_is_hardly_ever_found_is_gone(hits: int, *, gone: bool) -> None:
    """Two boxes in some 27 looks are chance, six are a light that is hard to see."""
    rng, checker = np.random.default_rng(1), LightMapChecker(_PAIR)
    checker.begin_drive()
    for number, x in enumerate(np.arange(0.0, 45.0, 1.5).tolist()):
        shown = _PAIR if 10 <= number < 10 + hits else _PAIR[:1]
        checker.push(_seen(shown, x, rng), _camera(), _pose(x))
    found = checker.finish()
    assert found.seen[2] == hits
    assert [f.map_element_id for f in found.discrepancies] == ([2] if gone else [])
    assert all(f"none in {found.looks[2] - hits} of" in f.observed for f in found.discrepancies)


def test_looks_that_follow_each_other_count_for_a_third() -> None:
    """Six of six looks found the other light: so do 7 of 8 looks, by Laplace's rule."""
    rng, checker = np.random.default_rng(1), LightMapChecker(_PAIR)
    checker.begin_drive()
    for x in np.arange(20.0, 26.0).tolist():
        checker.push(_seen(_PAIR[:1], x, rng), _camera(), _pose(x))
    (finding,) = checker.finish().discrepancies
    assert finding.observations == 6
    assert finding.confidence == pytest.approx(1 - (1 / 8) ** 2)


def test_a_network_that_finds_few_of_the_lights_calls_none_missing() -> None:
    others = tuple(_light(3 + k, 55.0, 5.0 + 2 * k) for k in range(3))
    found = _drive((*_PAIR, *others), _PAIR[:1])
    assert found.recall < 0.3
    assert found.discrepancies == ()


def test_a_light_that_the_edge_of_the_image_cuts_was_not_looked_at() -> None:
    rng, whole, cut = np.random.default_rng(1), _light(1, 40.0, 0.0), _light(3, 30.0, 22.78)
    checker = LightMapChecker((whole, cut))
    checker.begin_drive()
    for number in range(9):
        x = 6e-3 * number
        checker.push(_seen((whole,), x, rng), _camera(), _pose(x))
    found = checker.finish()
    assert found.looks == {1: 9, 3: 0}
    assert found.discrepancies == ()


def test_a_new_light_whose_place_is_not_known_is_counted_and_not_told() -> None:
    """From one place a box says where a light is, and hardly how far."""
    rng, checker = np.random.default_rng(1), LightMapChecker(())
    checker.begin_drive()
    for number in range(8):
        x = 10.0 + 0.01 * number
        checker.push(_seen(_PAIR[:1], x, rng), _camera(), _pose(x))
    found = checker.finish()
    assert found.discrepancies == ()
    assert found.dropped == {"boxes of lights whose place is not known well": 1}


@pytest.mark.parametrize(("y", "hidden"), [(0.0, True), (4.0, False)])
def test_a_box_hides_what_lies_behind_it(y: float, *, hidden: bool) -> None:
    boxes = np.array([[15.0, y, 1.5, 5.0, 2.0, 3.0, 0.3]])
    points = np.array([[30.0, 0.0, 1.7], [10.0, 0.0, 1.7]])
    assert is_hidden(np.array([0.0, 0.0, 1.6]), points, boxes).tolist() == [hidden, False]


def test_settings_reject_what_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="most_hits"):
        LightCheckConfig(most_hits=1.0)
