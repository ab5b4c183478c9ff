"""Boxes in space against a known world, and against people's labels of real scenes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.cameras import Camera, make_camera
from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.layout import Placed
from percept.datasets.synthetic.lidar import cloud_of_scan
from percept.datasets.synthetic.sensor_rig import BASE, CAMERA_NAMES
from percept.datasets.synthetic.shapes import DETECTABLE
from percept.detection.space.positions import locate_boxes
from percept.lidar.merge import merge_clouds
from percept.lidar.prepare import prepare_detector

_F64 = NDArray[np.float64]

_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))
_SECOND = 10  # scans


@dataclass(frozen=True, slots=True)
class _Located:
    """One object in one image: how it is seen, and where its box was placed.

    Attributes:
        range_m: From the camera to the middle of the true box.
        points: Returns of all LiDARs from it.
        hidden: Share of its box that boxes of nearer objects cover.
        found_range_m: As it was found; NaN where unknown.
        outside_m: Distance of the place from the true box; 0 within.
    """

    range_m: float
    points: int
    hidden: float
    found_range_m: float
    outside_m: float


@pytest.fixture(scope="module")
def located() -> list[_Located]:
    """All objects in some images of two drives, with ordinary noise."""
    return [one for seed in (1, 2) for one in _locate_in_drive(seed)]


def _locate_in_drive(seed: int) -> Iterator[_Located]:
    drive = Drive(DriveConfig(seed=seed, seconds=2.2, cameras=CAMERA_NAMES, beam_share=0.8))
    detector = None
    for number in range(0, drive.scans, _SECOND):
        scans = [drive.scan(sensor, number) for sensor in range(len(drive.lidars))]
        clouds = [cloud_of_scan(s, m.name) for s, m in zip(scans, drive.lidars, strict=True)]
        places = {c.topic: m.T_base_sensor for c, m in zip(clouds, drive.lidars, strict=True)}
        merged = merge_clouds(clouds, places)
        level = Transform.identity(BASE, BASE)
        detector = detector or prepare_detector([merged], T_base_sensor=level, merged=True)
        result = detector.detect(merged)
        ids = np.concatenate([scan.object_ids for scan in scans])
        for camera in drive.cameras:
            seen = _objects_in(drive, camera, scans[0].stamp_ns)
            boxes = np.array([box for *_, box in seen]).reshape(-1, 4)
            found = locate_boxes(
                Detections2D(0, "", boxes, ("",) * len(boxes), np.ones(len(boxes))),
                camera.camera(),
                _into_camera(camera),
                result,
            )
            for row, (placed, T_base_object, _) in enumerate(seen):
                yield _Located(
                    range_m=_range_m(placed, T_base_object, camera),
                    points=int(np.count_nonzero(ids == placed.object_id)),
                    hidden=_hidden(row, boxes, [_range_m(p, T, camera) for p, T, _ in seen]),
                    found_range_m=float(found.range_m[row]),
                    outside_m=_outside_m(found.points_m[row], placed, T_base_object),
                )


def _into_camera(camera: CameraSensor) -> Transform:
    assert camera.T_base_sensor is not None
    return camera.T_base_sensor.inverse()


def _objects_in(
    drive: Drive, camera: CameraSensor, stamp_ns: int
) -> list[tuple[Placed, Transform, _F64]]:
    """Objects of which at least half is in the image, each with the box of its corners."""
    time_s = float(drive.ego.seconds(stamp_ns))
    T_map_base = Transform("map", BASE, drive.ego.poses(np.array([time_s]))[0])
    found = []
    for placed in drive.world.objects(time_s, float(T_map_base.translation_m[0]), 80):
        if placed.shape.label not in DETECTABLE:
            continue
        T_map_object = Transform("map", "object", drive.world.place(placed, time_s))
        T_base_object = T_map_base.inverse() @ T_map_object
        shape = placed.shape
        sizes = [shape.length_m, shape.width_m, shape.height_m]
        corners = T_base_object.apply(_CORNERS * sizes + shape.middle)
        in_camera = _into_camera(camera).apply(corners)
        if in_camera[:, 2].min() < 0.5:
            continue
        pixels, _ = camera.camera().project(in_camera)
        whole = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]) + 0.5
        box = np.clip(whole, 0, [*camera.image_size, *camera.image_size])
        if (box[2:] - box[:2]).prod() >= 0.5 * (whole[2:] - whole[:2]).prod():
            found.append((placed, T_base_object, box))
    return found


def _range_m(placed: Placed, T_base_object: Transform, camera: CameraSensor) -> float:
    middle = T_base_object.apply(np.atleast_2d(placed.shape.middle))
    return float(np.linalg.norm(_into_camera(camera).apply(middle)))


def _outside_m(point_m: _F64, placed: Placed, T_base_object: Transform) -> float:
    shape = placed.shape
    offset = T_base_object.inverse().apply(point_m[None])[0] - shape.middle
    half = np.array([shape.length_m, shape.width_m, shape.height_m]) / 2
    return float(np.linalg.norm(np.maximum(np.abs(offset) - half, 0)))


def _hidden(row: int, boxes: _F64, ranges_m: list[float]) -> float:
    x1, y1, x2, y2 = boxes[row]
    grid = np.stack(np.meshgrid(np.linspace(x1, x2, 20), np.linspace(y1, y2, 20)), axis=-1)
    nearer = boxes[np.array(ranges_m) < ranges_m[row]][:, :, None, None]
    u, v = grid[..., 0], grid[..., 1]
    covered = (u >= nearer[:, 0]) & (v >= nearer[:, 1]) & (u <= nearer[:, 2]) & (v <= nearer[:, 3])
    return float(covered.any(axis=0).mean())


def _known(located: list[_Located]) -> list[_Located]:
    return [one for one in located if np.isfinite(one.found_range_m)]


def test_objects_within_30_m_are_where_they_are(located: list[_Located]) -> None:
    """The range is to the middle of the true box; what is measured is the side that is seen."""
    visible = [o for o in located if o.range_m <= 30 and o.points >= 10 and o.hidden < 0.5]
    known = _known(visible)
    assert len(visible) >= 100
    assert len(known) >= 0.9 * len(visible)
    assert np.median([abs(o.found_range_m - o.range_m) for o in known]) < 0.5
    assert np.mean([o.outside_m <= 0.5 for o in known]) >= 0.97


def test_what_is_partly_hidden_is_not_taken_for_what_hides_it(located: list[_Located]) -> None:
    pairs = _known([o for o in located if o.points >= 10 and 0.1 <= o.hidden < 0.6])
    assert len(pairs) >= 20
    assert np.mean([o.outside_m > 2 for o in pairs]) <= 0.05


def test_what_is_in_plain_view_is_hardly_ever_somewhere_else(located: list[_Located]) -> None:
    """At any range, with any number of points, none included: unknown rather than wrong."""
    plain = [o for o in located if o.hidden < 0.1]
    wrong = [o for o in _known(plain) if o.outside_m > 2]
    assert len(plain) >= 200
    assert len(wrong) <= 0.02 * len(plain)


def test_objects_without_points_are_unknown(located: list[_Located]) -> None:
    none = [o for o in located if o.points == 0]
    assert len(none) >= 20
    assert len(_known(none)) <= 0.1 * len(none)


@dataclass(frozen=True, slots=True, eq=False)
class _RealScene:
    """A real image with a cloud: labelled boxes and the middles of their objects."""

    cloud: PointCloud
    camera: Camera
    T_camera_cloud: Transform
    boxes_px: _F64
    middles_cam: _F64


def _kitti_cloud(path: Path) -> PointCloud:
    scan = np.fromfile(path, np.float32).reshape(-1, 4)
    return PointCloud(
        topic="/velodyne",
        stamp_ns=0,
        log_time_ns=0,
        frame="velodyne",
        points_xyz=scan[:, :3],
        intensity=scan[:, 3],
    )


def _scene(
    cloud: Path, P: _F64, T_rect_velo: _F64, labels: list[list[float]], size: tuple[int, int]
) -> _RealScene:
    """Make a scene; labels are x1, y1, x2, y2, height, x, y, z in the rectified frame."""
    camera = make_camera("pinhole", size, P[:, :3], [])
    baseline_m = np.linalg.inv(P[:, :3]) @ P[:, 3]
    matrix = T_rect_velo.copy()
    matrix[:3, 3] += baseline_m
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    matrix[:3, :3] = u @ vt
    rows = np.array(labels)
    middles = rows[:, 5:8] - rows[:, [4]] / 2 * [0, 1, 0] + baseline_m
    return _RealScene(
        _kitti_cloud(cloud), camera, Transform("cam", "velodyne", matrix), rows[:, :4], middles
    )


def _kitti_000008(scenes: Path) -> _RealScene:
    folder = scenes / "kitti_000008"
    frame = json.loads((folder / "000008.json").read_text())["data_list"][0]
    camera = frame["images"]["CAM2"]
    cars = [o for o in frame["instances"] if o["bbox_label"] >= 0]
    labels = [[*o["bbox"], o["bbox_3d"][4], *o["bbox_3d"][:3]] for o in cars]
    P = np.array(camera["cam2img"])[:3]
    size = (camera["width"], camera["height"])
    return _scene(folder / "000008.bin", P, np.array(camera["lidar2cam"]), labels, size)


def _kitti_object(scenes: Path, name: str, size: tuple[int, int]) -> _RealScene:
    folder = scenes / "kitti_object" / "training"
    lines = (folder / "calib" / f"{name}.txt").read_text().split("\n")
    calib = {k: np.array(v.split(), float) for k, _, v in (line.partition(":") for line in lines)}
    R, T = np.eye(4), np.eye(4)
    R[:3, :3] = calib["R0_rect"].reshape(3, 3)
    T[:3] = calib["Tr_velo_to_cam"].reshape(3, 4)
    lines = (folder / "label_2" / f"{name}.txt").read_text().splitlines()
    rows = [line.split() for line in lines]
    numbers = [list(map(float, row[4:])) for row in rows if row[0] != "DontCare"]
    labels = [[*row[:4], row[4], *row[7:10]] for row in numbers]
    P = calib["P2"].reshape(3, 4)
    return _scene(folder / "velodyne" / f"{name}.bin", P, R @ T, labels, size)


def _errors_m(scene: _RealScene) -> tuple[_F64, _F64]:
    """Distance of each place from the labelled middle, and the labelled range."""
    result = prepare_detector([scene.cloud]).detect(scene.cloud)
    count = len(scene.boxes_px)
    boxes = Detections2D(0, "cam", scene.boxes_px, ("",) * count, np.ones(count))
    found = locate_boxes(boxes, scene.camera, scene.T_camera_cloud, result)
    places_cam = scene.T_camera_cloud.apply(found.points_m)
    ranges_m = np.linalg.norm(scene.middles_cam, axis=1)
    return np.linalg.norm(places_cam - scene.middles_cam, axis=1), ranges_m


def test_the_labelled_cars_of_a_real_scene_are_found_at_their_places(shared_data: Path) -> None:
    """All six, though two are cut off by the border; half a car's length is the most."""
    errors_m, _ = _errors_m(_kitti_000008(shared_data / "scenes"))
    assert len(errors_m) == 6
    assert np.median(errors_m) < 1
    assert errors_m.max() < 2.1


def test_the_labelled_people_of_real_scenes_are_found_at_their_places(shared_data: Path) -> None:
    """A person at 9 m; a truck at 69 m, whose rear is seen, and a cyclist at 46 m.

    The car at 61 m has no cluster of its own, and is unknown.
    """
    scenes = shared_data / "scenes"
    (person_m,), _ = _errors_m(_kitti_object(scenes, "000000", (1224, 370)))
    assert person_m < 0.3
    (truck_m, car_m, cyclist_m), _ = _errors_m(_kitti_object(scenes, "000001", (1242, 375)))
    assert truck_m < 6.5  # it is 12.3 m long
    assert np.isnan(car_m) or car_m < 2.5
    assert cyclist_m < 0.4
