"""The tracker of lights: arrival orders, what is not seen, rates, maps, several cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.core.results import Detections2D, LightStates
from percept.core.rig import CameraSensor
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.hdmap.light import MapLight
from percept.lights import LightConfig, LightTracker
from percept.lights.projection import project_lights

_MS = 1_000_000
_BOX = (100.0, 50.0, 110.0, 80.0)


def _image(
    time_ms: int, labels: Sequence[str], boxes: object = None, camera: str = "front"
) -> Detections2D:
    corners = np.array([_BOX] * len(labels) if boxes is None else boxes, dtype=np.float64)
    return Detections2D(
        time_ms * _MS, camera, corners.reshape(-1, 4), tuple(labels), np.full(len(labels), 0.9)
    )


def _flash(time_ms: int) -> str:
    return "light_red" if time_ms % 1100 < 600 else "light_off"


def _same(first: LightStates, second: LightStates) -> None:
    assert first.stamp_ns == second.stamp_ns
    assert first.states == second.states
    assert first.cameras == second.cameras
    np.testing.assert_array_equal(first.ids, second.ids)
    np.testing.assert_array_equal(first.flashing, second.flashing)
    np.testing.assert_allclose(first.probabilities, second.probabilities, atol=1e-9)


def test_nothing_is_known_before_the_first_image() -> None:
    tracker = LightTracker()
    assert len(tracker.lights(0)) == 0
    tracker.push(_image(100, ["red"]))
    assert len(tracker.lights(99 * _MS)) == 0
    assert list(tracker.history()) == []


def test_a_light_is_reported_from_its_third_box_on_with_hindsight_from_its_first() -> None:
    tracker = LightTracker()
    for time in (0, 100, 200):
        assert len(tracker.lights(time * _MS)) == 0
        tracker.push(_image(time, ["red"]))
    assert tracker.lights(200 * _MS).states == ("red",)
    assert len(tracker.lights(150 * _MS)) == 0
    assert [states.stamp_ns for states in tracker.history()] == [0, 100 * _MS, 200 * _MS]
    assert len(list(tracker.history(smoothed=False))) == 1


@pytest.mark.parametrize("seed", range(4))
def test_any_order_of_arrival_within_the_window_gives_the_same(seed: int) -> None:
    images = [
        _image(time, [_flash(time)] if time % 700 else [], None if time % 700 else [], camera)
        for time in range(0, 4000, 100)
        for camera in ("front", "left")
    ]
    in_order, shuffled = LightTracker(), LightTracker()
    for image in images:
        in_order.push(image)
    late = np.random.default_rng(seed).uniform(0, 900 * _MS, len(images))
    stamps = [image.stamp_ns for image in images]
    for number in np.argsort(np.array(stamps) + late):
        shuffled.push(images[number])
    assert not shuffled.dropped
    for first, second in zip(in_order.history(), shuffled.history(), strict=True):
        assert first.states == second.states
        np.testing.assert_allclose(first.probabilities, second.probabilities, atol=1e-9)
    time = 3456 * _MS
    assert in_order.lights(time).states == shuffled.lights(time).states


def test_an_image_beyond_the_window_changes_nothing_and_is_counted() -> None:
    tracker = LightTracker()
    for time in range(0, 2000, 100):
        tracker.push(_image(time, ["red"]))
    before = tracker.lights(1900 * _MS)
    tracker.push(_image(850, ["green"]))
    _same(before, tracker.lights(1900 * _MS))
    assert tracker.dropped == {"image came later than the reorder window": 1}


def test_what_is_not_seen_is_not_dark() -> None:
    unseen, dark = LightTracker(), LightTracker()
    for time in range(0, 3700, 100):
        shown = time <= 2000
        unseen.push(_image(time, ["red"] if shown else []))
        dark.push(_image(time, ["red"] if shown else ["off"]))
    assert unseen.lights(3400 * _MS).states == ("red",)
    assert unseen.lights(3400 * _MS).cameras == ((),)
    assert dark.lights(2500 * _MS).states == ("red",)
    assert dark.lights(3600 * _MS).states == ("dark",)
    assert dark.lights(3600 * _MS).cameras == (("front",),)
    assert len(unseen.lights(4000 * _MS)) == 0  # forgotten


def test_boxes_that_tell_no_colour_leave_the_state_open() -> None:
    tracker = LightTracker()
    for time in range(0, 2000, 100):
        tracker.push(_image(time, ["traffic light"]))
    states = tracker.lights(1900 * _MS)
    assert states.states == ("unknown",)
    assert not states.flashing[0]


def test_red_that_is_read_green_for_a_moment_stays_red_or_open() -> None:
    tracker = LightTracker()
    said = set()
    for time in range(0, 5000, 100):
        tracker.push(_image(time, ["green" if time in (2000, 2100, 3000) else "red"]))
        said |= set(tracker.lights(time * _MS).states)
    assert "green" not in said
    assert {state for states in tracker.history() for state in states.states} == {"red"}


@pytest.mark.parametrize(("step_ms", "found"), [(50, True), (100, True), (200, True), (350, False)])
def test_flashing_is_told_at_rates_that_allow_it(step_ms: int, *, found: bool) -> None:
    tracker = LightTracker()
    for time in range(0, 12_000, step_ms):
        tracker.push(_image(time, [_flash(time)]))
    assert bool(tracker.lights(11_900 * _MS).flashing.any()) is found
    assert bool(tracker.notes) is not found
    if not found:
        assert "less than 4 times a second" in tracker.notes[0]
        assert not any(states.flashing.any() for states in tracker.history())


def test_flashing_waits_for_a_full_cycle_and_hindsight_does_not() -> None:
    tracker = LightTracker()
    first = None
    for time in range(0, 5000, 100):
        tracker.push(_image(time, [_flash(time)]))
        if first is None and tracker.lights(time * _MS).flashing.any():
            first = time
    assert first is not None
    assert 1200 <= first <= 2300
    assert all(states.flashing.all() for states in tracker.history())


def test_broken_boxes_are_counted_and_other_things_are_not() -> None:
    tracker = LightTracker()
    boxes = [_BOX, (10, 10, 5, 20), (np.nan, 0, 1, 1), (0, 0, 50, 50)]
    tracker.push(_image(0, ["red", "red", "green", "car"], boxes))
    assert tracker.dropped == {"light box without a size or not finite": 2}


def test_steps_that_no_rewind_can_reach_give_their_boxes_back() -> None:
    tracker = LightTracker()
    for time in range(0, 5000, 100):
        tracker.push(_image(time, ["red"]))
    assert not tracker._steps[10].tracks
    assert tracker._steps[-11].tracks


# --- with a map -------------------------------------------------------------------------------

_FORWARD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # optical axes in the base frame


def _camera(name: str, y_m: float) -> CameraSensor:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = _FORWARD, [1.0, y_m, 1.5]
    place = Transform("base_link", name, matrix)
    return CameraSensor(
        name, None, name, (1280, 720), "pinhole", (900, 900, 640, 360), (0, 0, 0, 0, 0), place
    )


def _light(light_id: int, y_m: float, groups: tuple[int, ...] = ()) -> MapLight:
    face = np.array([[40, y_m + 0.2, 4.5], [40, y_m - 0.2, 4.5], [40, y_m - 0.2, 5.5]])
    corners = np.vstack([face, [[40, y_m + 0.2, 5.5]]])
    return MapLight(
        light_id=light_id, corners_map=corners, facing=np.array([-1.0, 0, 0]), group_ids=groups
    )


_RIG = {name: _camera(name, y_m) for name, y_m in (("front", 0.3), ("left", -0.3))}
_POSES = Trajectory("map", "base_link", np.array([0, 10**11]), np.tile(np.eye(4), (2, 1, 1)))


def _boxes(lights: Sequence[MapLight], camera: str) -> NDArray[np.float64]:
    pose = _POSES.at(0)
    assert pose is not None
    shift: NDArray[np.float64] = np.tile([3.0, -5.0], 2)
    return project_lights(lights, pose, _RIG[camera]).boxes_px + shift


def test_all_cameras_tell_of_the_lights_of_the_map() -> None:
    lights = [_light(71, 3.0), _light(72, -3.0)]
    tracker = LightTracker(lights=lights, cameras=_RIG, poses=_POSES)
    for time in range(0, 2000, 100):
        tracker.push(_image(time, ["red", "green"], _boxes(lights, "front")))
        tracker.push(_image(time + 40, ["red", "green"], _boxes(lights, "left"), "left"))
    states = tracker.lights(2000 * _MS)
    assert states.ids.tolist() == [71, 72]
    assert states.states == ("red", "green")
    assert states.cameras == (("front", "left"), ("front", "left"))
    assert not tracker.dropped


@pytest.mark.parametrize("fuse", [True, False])
def test_lights_of_one_group_add_up(*, fuse: bool) -> None:
    lights = [_light(71, 3.0, (9,)), _light(72, -3.0, (9,))]
    tracker = LightTracker(LightConfig(fuse_groups=fuse), lights=lights, cameras=_RIG, poses=_POSES)
    boxes = _boxes(lights, "front")
    for time in range(0, 2000, 100):
        tracker.push(_image(time, ["traffic light", "red"], boxes))
    assert tracker.lights(1900 * _MS).states == (("red" if fuse else "unknown"), "red")


def test_a_light_of_the_map_survives_a_long_occlusion_under_its_id() -> None:
    lights = [_light(71, 3.0)]
    tracker = LightTracker(lights=lights, cameras=_RIG, poses=_POSES)
    for time in range(0, 9000, 100):
        hidden = 2000 <= time < 6000
        boxes = _boxes(lights, "front")[: 0 if hidden else 1]
        tracker.push(_image(time, [] if hidden else ["red"], boxes))
    assert tracker.lights(4000 * _MS).states == ("red",)
    assert tracker.lights(8900 * _MS).ids.tolist() == [71]
    assert len(tracker.lights(30_000 * _MS)) == 0


def test_what_the_map_cannot_place_is_counted() -> None:
    lights = [_light(71, 3.0)]
    tracker = LightTracker(lights=lights, cameras=_RIG, poses=_POSES)
    tracker.push(_image(0, ["red"], camera="rear"))
    tracker.push(_image(200_000, ["red"]))
    tracker.push(_image(199_900, ["red"], [(600, 600, 610, 630)]))
    assert tracker.dropped == {
        "image of camera 'rear', which is not in the rig": 1,
        "image at a time without a pose": 2,
    }
    tracker = LightTracker(lights=lights, cameras=_RIG, poses=_POSES)
    tracker.push(_image(0, ["red"], [(600, 600, 610, 630)]))
    assert tracker.dropped == {"light box where the map has no light": 1}


def test_a_map_needs_cameras_and_poses() -> None:
    with pytest.raises(UsageError, match="cameras of a rig and poses"):
        LightTracker(lights=[_light(1, 0.0)])
