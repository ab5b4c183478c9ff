"""Tracked boxes in an image: where they appear, which box shows which, and what is hidden."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import Camera, make_camera
from percept.core.transform import Transform
from percept.tracking.image_match import ImageMatchConfig, match_in_image, project_boxes

_K = np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1]])
_CAMERA = make_camera("pinhole", (640, 480), _K, [0.0])
# The camera looks along +x of the inertial frame, 1.5 m above the ground.
_AXES = np.array([[0, -1, 0, 0], [0, 0, -1, 1.5], [1, 0, 0, 0], [0, 0, 0, 1.0]])
_LOOKING_EAST = Transform("cam", "map", _AXES)
_CONFIG = ImageMatchConfig()


def box(
    x: float, y: float, length: float = 4.0, width: float = 2.0, yaw: float = 0.0
) -> list[float]:
    return [x, y, 1.5, length, width, 1.6, yaw]


def project(*boxes: list[float], camera: Camera = _CAMERA) -> NDArray[np.float64]:
    return project_boxes(np.array(boxes), _LOOKING_EAST, camera).boxes_px


def match(
    boxes: list[list[float]],
    seen: NDArray[np.float64],
    costs: NDArray[np.float64] | None = None,
    config: ImageMatchConfig = _CONFIG,
) -> list[int]:
    if costs is None:
        costs = np.zeros((len(boxes), len(seen)))
    tracked = np.array(boxes).reshape(-1, 7)
    return [int(i) for i in match_in_image(tracked, _LOOKING_EAST, _CAMERA, seen, costs, config)]


def test_a_box_ahead_projects_to_its_near_face() -> None:
    (found,) = project(box(12.0, 0.0))
    # The near face is 10 m away: 2 m wide and 1.6 m high are 100 and 80 pixels.
    assert found == pytest.approx([319.5 - 50, 239.5 - 40, 319.5 + 50, 239.5 + 40])


def test_yaw_turns_the_box() -> None:
    (found,) = project(box(12.0, 0.0, yaw=np.pi / 2))
    assert found[2] - found[0] == pytest.approx(500 * 4 / 11)


def test_boxes_behind_the_camera_or_beside_the_image_have_no_area() -> None:
    behind, beside, above = project(
        box(-12.0, 0.0), box(5.0, 30.0), [12.0, 0.0, 30.0, 4.0, 2.0, 1.6, 0.0]
    )
    for found in (behind, beside, above):
        assert (found[2] - found[0]) * (found[3] - found[1]) == 0


def test_a_box_that_reaches_beside_the_camera_is_cut_off_at_the_border() -> None:
    (found,) = project(box(1.0, 2.0, length=8.0))
    # Its right side is 1 m to the left, its far end 5 m ahead: it ends 100 px left of the middle.
    assert found == pytest.approx([-0.5, -0.5, 319.5 - 100, 479.5])


def test_an_image_inside_a_wide_box_is_covered_by_it() -> None:
    (found,) = project(box(8.0, 0.0, width=60.0))
    assert found[[0, 2]] == pytest.approx([-0.5, 639.5])


def test_beyond_the_fold_of_the_lens_a_box_reaches_the_border_and_no_further() -> None:
    folding = make_camera("pinhole", (640, 480), _K, [-0.3])
    assert folding.widest_rad < np.radians(70)
    (cut,) = project(box(4.0, 4.0, length=6.0), camera=folding)
    assert cut[0] == -0.5
    assert 0 < cut[2] < 319.5
    (outside,) = project(box(1.0, 8.0), camera=folding)
    assert outside[2] - outside[0] == 0


def test_each_box_finds_its_object() -> None:
    objects = [box(20.0, 4.0), box(20.0, -4.0), box(35.0, 0.0)]
    seen = project(*objects)[[2, 0, 1]] + [[2, -1, 3, 1]]
    assert match(objects, seen) == [2, 0, 1]


def test_a_box_where_no_object_is_stays_alone() -> None:
    objects = [box(20.0, 4.0)]
    elsewhere = project(box(20.0, -4.0))
    assert match(objects, elsewhere) == [-1]
    assert match(objects, np.array([[100.0, 100.0, 100.0, 100.0]])) == [-1]


def test_a_box_of_quite_another_shape_at_the_same_place_is_no_match() -> None:
    (seen,) = project(box(20.0, 0.0))
    middle = 0.5 * (seen[:2] + seen[2:])
    small = np.hstack([middle - 4, middle + 4])[None]
    assert match([box(20.0, 0.0)], small) == [-1]


def test_of_two_on_one_line_of_sight_the_nearer_is_seen() -> None:
    near, far = box(15.0, 0.0), box(24.0, 0.2)
    looks_like_far = project(far)
    assert match([far, near], looks_like_far) == [1]
    assert match([far], looks_like_far) == [0]


def test_a_box_around_the_camera_hides_nothing() -> None:
    around = [0.0, 0.0, 1.5, 6.0, 3.0, 3.0, 0.0]
    far = box(24.0, 0.2)
    assert match([around, far], project(far)) == [1]


def test_the_class_decides_between_neighbours() -> None:
    objects = [box(20.0, 0.3), box(20.0, -0.3)]
    middle = project(box(20.0, 0.0))
    # Equal distance to both; one cannot be of the box's class.
    config = ImageMatchConfig(hidden_share=1.0)
    assert match(objects, middle, np.array([[1.0], [0.0]]), config) == [1]
    assert match(objects, middle, np.array([[0.0], [1.0]]), config) == [0]


def test_no_object_takes_two_boxes() -> None:
    seen = project(box(20.0, 0.0))
    twice = np.vstack([np.add(seen, [[6, 0, 6, 0]]), seen])
    assert match([box(20.0, 0.0)], twice) == [-1, 0]


def test_nothing_to_match() -> None:
    assert match([], project(box(20.0, 0.0))) == [-1]
    assert match([box(20.0, 0.0)], np.zeros((0, 4))) == []
