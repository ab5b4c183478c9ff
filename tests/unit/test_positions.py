"""Boxes in space: which of the points in a box are its object, and when that is unknown."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import make_camera
from percept.core.errors import GeometryError
from percept.core.results import Detections2D, Detections3D
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.detection.result import Positions
from percept.detection.space.positions import best_positions, locate_boxes, locate_in_depth
from percept.lidar.result import ScanResult

_F64 = NDArray[np.float64]

CAMERA = make_camera("pinhole", (640, 400), [[400.0, 0, 319.5], [0.0, 400, 199.5], [0.0, 0, 1]], [])
_MATRIX = np.eye(4)
_MATRIX[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
_MATRIX[:3, 3] = 0.5, 0.1, 1.6
T_BASE_CAMERA = Transform("base_link", "front", _MATRIX)
T_CAMERA_BASE = T_BASE_CAMERA.inverse()


def _plate(depth_m: float, x_m: tuple[float, float], y_m: tuple[float, float]) -> _F64:
    """An upright plate in the optical frame, as beams 0.2 deg apart meet it, in the base frame."""
    step = np.radians(0.2) * depth_m
    x, y = np.meshgrid(np.arange(*x_m, step), np.arange(*y_m, step))
    points_cam = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, depth_m)])
    return T_BASE_CAMERA.apply(points_cam)


def _scan(*parts: tuple[int, _F64]) -> ScanResult:
    """A scan of points with the number of their cluster, -1 for none and -2 for the ground."""
    points = np.concatenate([p for _, p in parts]).astype(np.float32)
    ids = np.concatenate([np.full(len(p), k, np.int32) for k, p in parts])
    cloud = PointCloud(
        topic="/lidar", stamp_ns=0, log_time_ns=0, frame="base_link", points_xyz=points
    )
    count = max(int(ids.max(initial=-1)) + 1, 0)
    nothing = np.full(count, np.nan)
    boxes = np.zeros((count, 7))
    found = Detections3D(
        0, "top", "base_link", boxes, ("x",) * count, nothing, nothing, np.zeros(count, np.int64)
    )
    return ScanResult(cloud, ids == -2, np.maximum(ids, -1), found, {}, {})


def _box(depth_m: float, x_m: tuple[float, float], y_m: tuple[float, float]) -> list[float]:
    """The box around a plate, from the outer edge of the top left pixel."""
    corners = np.array([[x_m[0], y_m[0], depth_m], [x_m[1], y_m[1], depth_m]])
    pixels, _ = CAMERA.project(corners)
    return [*(pixels[0] + 0.5), *(pixels[1] + 0.5)]


def _detections(*boxes: list[float]) -> Detections2D:
    rows = np.array(boxes, np.float64).reshape(-1, 4)
    return Detections2D(0, "front", rows, ("thing",) * len(rows), np.ones(len(rows)))


def _located(scan: ScanResult, *boxes: list[float]) -> Positions:
    return locate_boxes(_detections(*boxes), CAMERA, T_CAMERA_BASE, scan)


_CAR = ((-0.9, 0.9), (0.2, 1.5))
_PERSON = ((-0.25, 0.25), (-0.2, 1.5))
_WALL = ((-12.0, 12.0), (-4.0, 1.5))


def test_a_cluster_gives_the_place_in_the_frame_of_the_cloud() -> None:
    scan = _scan((0, _plate(12, *_CAR)), (1, _plate(14, (3.0, 4.8), (0.2, 1.5))))
    found = _located(scan, _box(12, *_CAR))
    middle = T_BASE_CAMERA.apply(np.array([[0.0, 0.85, 12.0]]))
    np.testing.assert_allclose(found.points_m, middle, atol=0.05)
    assert found.frame_id == "base_link"
    assert found.range_m[0] == pytest.approx(np.hypot(12, 0.85), abs=0.05)
    assert found.sources == ("cluster",)
    assert found.points[0] == len(_plate(12, *_CAR))


def test_the_wall_behind_is_not_the_object() -> None:
    scan = _scan((0, _plate(12, *_CAR)), (1, _plate(20, *_WALL)), (-1, _plate(19, *_WALL)))
    assert _located(scan, _box(12, *_CAR)).range_m[0] == pytest.approx(12, abs=0.1)


def test_a_box_before_a_wall_without_points_of_its_own_is_unknown() -> None:
    """A black car takes all light: what is in its box goes on around it."""
    for cluster in (0, -1):
        found = _located(_scan((cluster, _plate(20, *_WALL))), _box(12, *_CAR))
        assert np.isnan(found.range_m[0])
        assert np.isnan(found.points_m).all()
        assert (found.sources, found.points[0]) == (("",), 0)


def test_a_post_before_a_car_is_not_the_car() -> None:
    post = _plate(9, (-0.06, 0.06), (-1.0, 1.5))
    scan = _scan((0, post), (1, _plate(12, *_CAR)))
    assert _located(scan, _box(12, *_CAR)).range_m[0] == pytest.approx(12, abs=0.1)


def test_a_sliver_of_what_stands_before_is_not_the_object() -> None:
    """A lorry's corner reaches into the box of the car behind it."""
    lorry = _plate(9, (0.3, 3.0), (-2.0, 1.5))
    scan = _scan((0, lorry), (1, _plate(15, *_CAR)))
    assert _located(scan, _box(15, *_CAR)).range_m[0] == pytest.approx(15, abs=0.1)


def test_a_person_before_a_bus_and_the_bus_are_both_right() -> None:
    bus = ((-4.0, 3.0), (-1.5, 1.5))
    scan = _scan((0, _plate(8, *_PERSON)), (1, _plate(12, *bus)))
    found = _located(scan, _box(12, *bus), _box(8, *_PERSON))
    np.testing.assert_allclose(found.range_m, [12, 8], atol=0.2)


def test_a_person_behind_a_car_is_not_the_car() -> None:
    """All of the person's box but the head lies before the car; the car has a box of its own."""
    car = ((-0.9, 0.9), (0.2, 1.5))
    head = _plate(14, (-0.25, 0.25), (-0.2, 0.2))
    scan = _scan((0, _plate(10, *car)), (1, head))
    found = _located(scan, _box(10, *car), _box(14, *_PERSON))
    np.testing.assert_allclose(found.range_m, [10, 14], atol=0.2)


def test_the_person_alone_is_unknown_when_all_points_in_its_box_are_the_cars() -> None:
    scan = _scan((0, _plate(10, *_CAR)))
    found = _located(scan, _box(10, *_CAR), _box(14, *_PERSON))
    assert found.range_m[0] == pytest.approx(10, abs=0.1)
    assert np.isnan(found.range_m[1])


def test_two_boxes_of_one_object_have_one_place() -> None:
    """A network may call it a car and a lorry; neither is a stranger to the cluster."""
    box = _box(12, *_CAR)
    found = _located(_scan((0, _plate(12, *_CAR))), box, [box[0] - 2, box[1], box[2], box[3] + 3])
    np.testing.assert_array_equal(found.points_m[0], found.points_m[1])


def test_a_person_who_is_one_cluster_with_a_car_is_found_by_the_box() -> None:
    person = ((1.0, 1.5), (-0.2, 1.5))
    scan = _scan((0, np.concatenate([_plate(12, *_CAR), _plate(12.4, *person)])))
    found = _located(scan, _box(12, *_CAR), _box(12.4, *person))
    np.testing.assert_allclose(T_CAMERA_BASE.apply(found.points_m)[:, 0], [0, 1.25], atol=0.15)


def test_a_sliver_alone_is_no_object() -> None:
    lorry = _plate(9, (0.3, 3.0), (-2.0, 1.5))
    assert np.isnan(_located(_scan((0, lorry)), _box(15, *_CAR)).range_m[0])


def test_a_car_is_not_taken_for_the_one_beside_it() -> None:
    """The box of the other, of which nothing is measured, holds two thirds of this one."""
    box = _box(10, *_CAR)
    other = list(np.array(box) + 0.35 * (box[2] - box[0]) * np.array([1, 0, 1, 0]))
    found = _located(_scan((0, _plate(10, *_CAR))), box, other)
    assert found.range_m[0] == pytest.approx(10, abs=0.1)
    assert np.isnan(found.range_m[1])


def test_a_barrel_before_a_car_is_not_the_car() -> None:
    """It lies wholly in the car's box, nearer, and takes two fifths of its width."""
    scan = _scan((0, _plate(9, (-0.27, 0.27), (0.3, 1.1))), (1, _plate(12, *_CAR)))
    assert _located(scan, _box(12, *_CAR)).range_m[0] == pytest.approx(12, abs=0.1)


def test_what_is_as_wide_as_a_box_but_much_taller_is_not_its_object() -> None:
    tower = _plate(12, (-0.9, 0.9), (-5.0, 1.5))
    assert np.isnan(_located(_scan((0, tower)), _box(12, *_CAR)).range_m[0])


def test_a_few_points_in_a_line_do_not_fill_a_box() -> None:
    wire = T_BASE_CAMERA.apply(np.array([[0.0, y, 11] for y in (0.4, 0.6, 0.8, 1.0)]))
    assert np.isnan(_located(_scan((-1, wire)), _box(12, *_CAR)).range_m[0])


def test_a_sign_without_a_cluster_wins_over_a_cluster_behind_it() -> None:
    """What stands behind fits the box as well by chance; as many beams meet the sign."""
    sign = _plate(30, (-0.4, 0.4), (-2.0, -1.2))
    behind = _plate(45, (-0.6, 0.6), (-3.0, -1.8))
    found = _located(_scan((-1, sign), (0, behind)), _box(30, (-0.42, 0.42), (-2.02, -1.18)))
    assert found.range_m[0] == pytest.approx(30, abs=0.5)


def test_a_few_drops_of_rain_before_a_car_do_not_win_over_it() -> None:
    drops = T_BASE_CAMERA.apply(
        np.array([[-0.4, 0.5, 8], [0, 0.7, 8], [0.1, 0.3, 8], [0.4, 0.6, 8]])
    )
    found = _located(_scan((-1, drops), (0, _plate(12, *_CAR))), _box(12, *_CAR))
    assert found.range_m[0] == pytest.approx(12, abs=0.1)


@pytest.mark.parametrize("count", [2, 3])
def test_a_far_sign_needs_three_points(count: int) -> None:
    """It stands before trees, has too few points for a cluster, and nothing else around it."""
    sign = T_BASE_CAMERA.apply(np.array([[-0.1, -1.5, 50], [0.1, -1.4, 50.1], [0.1, -1.6, 50]]))
    scan = _scan((-1, sign[:count]), (0, _plate(58, *_WALL)))
    found = _located(scan, _box(50, (-0.3, 0.3), (-1.8, -1.2)))
    assert bool(np.isfinite(found.range_m[0])) == (count == 3)
    if count == 3:
        assert found.range_m[0] == pytest.approx(50, abs=0.2)
        assert found.points[0] == 3


def test_the_ground_is_never_an_object() -> None:
    x, z = np.meshgrid(np.linspace(-3, 3, 60), np.linspace(5, 40, 200))
    ground = T_BASE_CAMERA.apply(np.column_stack([x.ravel(), np.full(x.size, 1.6), z.ravel()]))
    assert np.isnan(_located(_scan((-2, ground)), _box(12, (-0.9, 0.9), (0.2, 1.6))).range_m[0])


def test_points_behind_the_camera_and_empty_input_are_nothing() -> None:
    behind = _plate(12, *_CAR) * [-1, 1, 1]
    assert np.isnan(_located(_scan((0, behind)), _box(12, *_CAR)).range_m[0])
    assert _located(_scan((0, _plate(12, *_CAR)))).points_m.shape == (0, 3)
    empty = _scan((-1, np.zeros((0, 3))))
    assert _located(empty, _box(12, *_CAR)).sources == ("",)


def test_a_transform_from_another_frame_is_refused() -> None:
    other = Transform("front", "velodyne", T_CAMERA_BASE.matrix)
    with pytest.raises(GeometryError, match="T_front_velodyne does not fit a cloud in frame 'base"):
        locate_boxes(_detections(), CAMERA, other, _scan((0, _plate(12, *_CAR))))


def test_of_two_lidars_the_one_with_more_points_counts() -> None:
    near = _located(_scan((0, _plate(12, *_CAR))), _box(12, *_CAR), _box(12, (3, 4), (0, 1)))
    none = replace(near, points=near.points // 2, range_m=near.range_m + 1)
    joined = best_positions([none, near])
    assert joined.range_m[0] == near.range_m[0]
    assert joined.sources == ("cluster", "")
    assert np.isnan(joined.range_m[1])
    for wrong in (
        [],
        [near, replace(near, frame_id="x")],
        [near, Positions.unknown(1, "base_link")],
    ):
        with pytest.raises(GeometryError, match="same boxes"):
            best_positions(wrong)


def _depth_image(**places: tuple[float, list[float]]) -> NDArray[np.float32]:
    depth = np.full((400, 640), 20, np.float32)
    for depth_m, (x1, y1, x2, y2) in places.values():
        depth[round(y1) : round(y2), round(x1) : round(x2)] = depth_m
    return depth


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
@pytest.mark.parametrize("scale", [1, 2])
def test_a_depth_image_gives_the_near_mode_of_the_middle(dtype: Any, scale: int) -> None:
    box = _box(6, *_PERSON)
    depth = _depth_image(person=(6, box))[::scale, ::scale]
    depth = (depth * 1000).astype(dtype) if dtype == np.uint16 else depth.astype(dtype)
    found = locate_in_depth(_detections(box), CAMERA, depth, T_BASE_CAMERA)
    middle = T_BASE_CAMERA.apply(np.array([[0.0, 0.65, 6.0]]))
    np.testing.assert_allclose(found.points_m, middle, atol=0.02)
    assert found.range_m[0] == pytest.approx(np.hypot(6, 0.65), abs=0.02)
    assert (found.frame_id, found.sources) == ("base_link", ("depth",))


def test_the_background_beside_a_thin_object_does_not_count_in_a_depth_image() -> None:
    """The person fills a third of the middle; the wall behind fills the rest."""
    box = [100.0, 100, 160, 300]
    depth = _depth_image(person=(5, [115, 100, 125, 300]))
    found = locate_in_depth(_detections(box), CAMERA, depth, T_BASE_CAMERA)
    ray = CAMERA.unproject(np.array([[129.5, 199.5]]))[0]
    assert found.range_m[0] == pytest.approx(5 / ray[2])


@pytest.mark.parametrize("unknown", [0, np.nan, np.inf, -1])
def test_depth_that_is_not_known_gives_no_place(unknown: float) -> None:
    depth = np.full((400, 640), unknown, np.float32)
    depth[150:160, 150:160] = 7
    found = locate_in_depth(_detections([10, 10, 300, 300]), CAMERA, depth, T_BASE_CAMERA)
    assert np.isnan(found.range_m[0])
    assert np.isnan(found.points_m).all()
    assert (found.sources, found.points[0]) == (("",), 0)


def test_boxes_out_of_the_depth_image_and_none_at_all() -> None:
    depth = np.full((400, 640), 7, np.float32)
    boxes = ([-90.0, -90, -10, -10], [700.0, 10, 800, 100], [0.0, 0, 640, 400])
    found = locate_in_depth(_detections(*boxes), CAMERA, depth, T_BASE_CAMERA)
    assert found.sources == ("", "", "depth")
    assert locate_in_depth(_detections(), CAMERA, depth, T_BASE_CAMERA).points_m.shape == (0, 3)


@pytest.mark.parametrize(
    "depth",
    [
        np.zeros((400, 640), np.uint8),
        np.zeros((400, 640, 3), np.float32),
        np.zeros((0, 0), np.float32),
        np.zeros((400, 400), np.float32),
    ],
)
def test_what_is_no_depth_image_of_the_camera_is_refused(depth: NDArray[Any]) -> None:
    with pytest.raises(GeometryError, match="depth image"):
        locate_in_depth(_detections([0, 0, 9, 9]), CAMERA, depth, T_BASE_CAMERA)
