"""The LiDAR path as a whole: on a made street, on hostile clouds, tilted, and on real scans."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import ConfigError, GeometryError, InsufficientDataError
from percept.core.samples import PointCloud
from percept.core.settings import parse_settings
from percept.core.transform import Transform, rotation_from_rpy
from percept.lidar import (
    Classification,
    ClusterFeatures,
    IntensityScale,
    LidarConfig,
    LidarDetector,
    Rules,
    ScanResult,
    classify_clusters,
    normalise_intensity,
    pipeline,
    prepare_detector,
)
from percept.lidar.boxes import fit_boxes
from percept.lidar.density import estimate_density, fill_of
from percept.lidar.elevation import ground_height_at

_HEIGHT_M = 1.8
_CAR_XY = (12.0, 3.0)
_CAR_YAW = 0.4


def _surface(
    rng: np.random.Generator, count: int, low: tuple[float, ...], high: tuple[float, ...]
) -> NDArray[np.float64]:
    return rng.uniform(low, high, (count, 3))


def _street(slope: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Points and intensities of a road that may rise ahead, a car, a barrel and a wall."""
    rng = np.random.default_rng(11)
    ring = np.repeat(np.arange(3.0, 60.0), 700)
    angle = np.tile(np.linspace(-np.pi, np.pi, 700, endpoint=False), 57)
    road = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), np.zeros(len(ring))])
    side = _surface(rng, 900, (-2.2, -0.9, 0.0), (2.2, -0.9, 1.5))
    rear = _surface(rng, 400, (-2.2, -0.9, 0.0), (-2.2, 0.9, 1.5))
    c, s = np.cos(_CAR_YAW), np.sin(_CAR_YAW)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    car = np.vstack([side, rear]) @ turn + [*_CAR_XY, 0]
    facing = rng.uniform(np.pi / 2, 3 * np.pi / 2, 200)
    barrel = np.column_stack(
        [8 + 0.28 * np.cos(facing), -4 + 0.28 * np.sin(facing), rng.uniform(0, 1.0, 200)]
    )
    wall = _surface(rng, 4000, (-20, 15, 0.0), (20, 15.2, 5.0))
    parts = [(road, 0.1), (car, 0.15), (barrel, 0.95), (wall, 0.35)]
    points = np.vstack([part for part, _ in parts])
    points[:, 2] += slope * np.maximum(points[:, 0] - 6, 0)
    intensity = np.concatenate([np.full(len(part), level) for part, level in parts])
    intensity += rng.uniform(0, 0.02, len(intensity))
    return points - [0, 0, _HEIGHT_M], (255 * np.minimum(intensity, 1)).astype(np.float32)


def _cloud(points: NDArray[np.floating], intensity: NDArray[np.float32] | None) -> PointCloud:
    return PointCloud(
        topic="/points",
        stamp_ns=5,
        log_time_ns=6,
        frame="lidar",
        points_xyz=points.astype(np.float32),
        intensity=intensity,
    )


def _row(result: ScanResult, label: str) -> int:
    assert result.detections.labels.count(label) == 1, result.detections.labels
    return result.detections.labels.index(label)


def _bytes(result: ScanResult) -> bytes:
    found = result.detections
    arrays = (result.ground, result.cluster_ids, found.boxes_m, found.confidences,
              found.mean_intensity, found.points)  # fmt: skip
    return b"".join(array.tobytes() for array in arrays) + repr(found.labels).encode()


@pytest.fixture(scope="module")
def street() -> PointCloud:
    return _cloud(*_street())


@pytest.fixture(scope="module")
def detector(street: PointCloud) -> LidarDetector:
    return prepare_detector([street], sensor="top")


@pytest.fixture(scope="module")
def result(detector: LidarDetector, street: PointCloud) -> ScanResult:
    return detector.detect(street)


def test_prepare_finds_height_and_intensity(detector: LidarDetector) -> None:
    assert detector.mounting.height_m == pytest.approx(_HEIGHT_M, abs=0.03)
    assert detector.mounting.tilt_deg < 0.3
    assert detector.intensity_scale is not None
    assert detector.intensity_scale.white == pytest.approx(0.36 * 255, rel=0.1)


def test_finds_the_car_and_the_barrel(result: ScanResult) -> None:
    found = result.detections
    car = found.boxes_m[_row(result, "car")]
    np.testing.assert_allclose(car[:2], _CAR_XY, atol=0.1)
    np.testing.assert_allclose(car[3:5], [4.4, 1.8], atol=0.15)
    assert car[6] == pytest.approx(_CAR_YAW, abs=0.02)
    barrel = _row(result, "barrel")
    np.testing.assert_allclose(found.boxes_m[barrel, :2], [7.85, -4], atol=0.15)
    assert found.confidences[barrel] > 0.6
    assert found.mean_intensity[barrel] == pytest.approx(0.96 * 255, rel=0.02)
    assert found.sensor == "top"
    assert found.frame_id == "lidar"


def test_columns_belong_together(result: ScanResult, street: PointCloud) -> None:
    found = result.detections
    sizes = np.bincount(result.cluster_ids[result.cluster_ids >= 0], minlength=len(found))
    assert sizes.tolist() == found.points.tolist()
    assert not (result.ground & (result.cluster_ids >= 0)).any()
    assert len(result.cloud) == len(result.ground) == len(result.cluster_ids)
    assert set(result.timings_ms) == {"ground", "cluster", "boxes", "classify"}
    assert result.dropped["clusters longer than 25 m"] == 1
    ranges = np.linalg.norm(street.points_xyz, axis=1)
    assert len(result.cloud) == (ranges <= 100).sum()


def test_a_box_has_the_mean_time_of_its_points(detector: LidarDetector, street: PointCloud) -> None:
    offset_ns = np.arange(len(street), dtype=np.int64) * 1000
    found = detector.detect(replace(street, offset_ns=offset_ns))
    assert found.cloud.offset_ns is not None
    for row in range(len(found.detections)):
        times = found.cloud.offset_ns[found.cluster_ids == row]
        assert found.detections.offsets_ns[row] == pytest.approx(times.mean(), abs=1)
    assert not detector.detect(street).detections.offsets_ns.any()


def test_the_same_scan_gives_the_same_bytes(
    detector: LidarDetector, street: PointCloud, result: ScanResult
) -> None:
    assert _bytes(detector.detect(street)) == _bytes(result)
    again = prepare_detector([street], sensor="top")
    assert _bytes(again.detect(street)) == _bytes(result)


@pytest.mark.parametrize("slope", [-0.1, 0.1])
def test_a_slope_changes_no_class(slope: float) -> None:
    cloud = _cloud(*_street(slope))
    config = LidarConfig(sensor_height_m=_HEIGHT_M, level=False)
    result = prepare_detector([cloud], config).detect(cloud)
    np.testing.assert_allclose(
        result.detections.boxes_m[_row(result, "car"), :2], _CAR_XY, atol=0.2
    )
    assert "barrel" in result.detections.labels


@pytest.mark.parametrize("rpy_deg", [(0, 5, 0), (-5, 0, 0), (180, 0, 0), (3, 12, 40)])
@pytest.mark.parametrize("levelled_by", ["rig", "ground plane"])
def test_a_tilted_sensor_reports_in_its_own_frame(
    rpy_deg: tuple[float, float, float], levelled_by: str, result: ScanResult
) -> None:
    R_base_sensor = rotation_from_rpy(*np.deg2rad(rpy_deg))
    points, intensity = _street()
    tilted = _cloud(points @ R_base_sensor, intensity)
    matrix = np.eye(4)
    matrix[:3, :3] = R_base_sensor
    rig = Transform("base_link", "lidar", matrix) if levelled_by == "rig" else None
    found = prepare_detector([tilted], T_base_sensor=rig).detect(tilted)
    car = found.detections.boxes_m[_row(found, "car")]
    upright = result.detections.boxes_m[_row(result, "car")]
    np.testing.assert_allclose(R_base_sensor @ car[:3], upright[:3], atol=0.1)
    np.testing.assert_allclose(car[3:6], upright[3:6], atol=0.15)
    heading = R_base_sensor @ [np.cos(car[6]), np.sin(car[6]), 0]
    turn = np.arctan2(heading[1], heading[0]) - upright[6]
    assert abs((turn + np.pi / 2) % np.pi - np.pi / 2) < 0.03
    assert -np.pi < car[6] <= np.pi


def test_hostile_clouds_give_no_box(detector: LidarDetector) -> None:
    empty = _cloud(np.empty((0, 3)), np.empty(0, np.float32))
    ground = _cloud(_street()[0][: 57 * 700], None)
    one = _cloud(np.array([[5.0, 0.0, 0.0]]), None)
    far = _cloud(np.array([[500.0, 0.0, 0.0]] * 20), None)
    for cloud in (empty, ground, one, far):
        result = detector.detect(cloud)
        assert len(result.detections) == 0
        assert (result.cluster_ids == -1).all()
    assert detector.detect(ground).ground.mean() > 0.99
    assert detector.detect(far).dropped == {"points farther than 100 m": 20}
    assert detector.detect(one).dropped == {
        "clusters below 10 points": 1,
        "points in clusters below 10": 1,
    }


def test_ranges_are_distances_in_space(detector: LidarDetector) -> None:
    far_above, close_below = [99.0, 0.0, 20.0], [0.6, 0.0, -1.2]
    result = detector.detect(_cloud(np.array([far_above, close_below]), None))
    assert result.dropped["points farther than 100 m"] == 1
    np.testing.assert_allclose(result.cloud.points_xyz, [close_below])


def test_intensity_is_made_up_for_the_distance_in_space(
    detector: LidarDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    ranges: list[float] = []

    def spy(
        intensity: NDArray[np.float32], range_m: NDArray[np.float32], scale: IntensityScale
    ) -> NDArray[np.float32]:
        ranges.extend(range_m.tolist())
        return normalise_intensity(intensity, range_m, scale)

    monkeypatch.setattr(pipeline, "normalise_intensity", spy)
    points = np.random.default_rng(0).uniform([3, -0.2, 3.8], [3.2, 0.2, 4.2], (50, 3))
    result = detector.detect(_cloud(points, np.full(50, 9, np.float32)))
    assert len(result.detections) == 1
    np.testing.assert_allclose(ranges, np.linalg.norm(points, axis=1), rtol=0.01)


def test_heights_are_over_the_ground_and_not_those_of_the_box(
    detector: LidarDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[ClusterFeatures] = []

    def spy(features: ClusterFeatures, rules: Rules) -> Classification:
        seen.append(features)
        return classify_clusters(features, rules)

    monkeypatch.setattr(pipeline, "classify_clusters", spy)
    road = _street()[0][: 57 * 700]
    lifted = np.random.default_rng(0).uniform([10, 2, 2.0], [11, 3, 2.6], (300, 3))
    detector.detect(_cloud(np.vstack([road, lifted - [0, 0, _HEIGHT_M]]), None))
    assert seen[0].height_m == pytest.approx([2.6], abs=0.06)
    assert seen[0].clearance_m == pytest.approx([2.0], abs=0.06)


def test_points_without_an_intensity_leave_the_mean_of_the_others(detector: LidarDetector) -> None:
    points = np.random.default_rng(0).uniform([8, 2, 0], [8.5, 2.5, 0.5], (60, 3))
    intensity = np.where(np.arange(60) % 2, np.nan, 9.0).astype(np.float32)
    result = detector.detect(_cloud(points, intensity))
    assert result.detections.mean_intensity.tolist() == [9.0]


def test_an_object_below_the_ground_that_is_seen_keeps_its_height(
    detector: LidarDetector,
) -> None:
    points, intensity = _street()
    car = slice(57 * 700, 57 * 700 + 1300)
    near = np.hypot(points[:, 0], points[:, 1]) < 30
    near[car] = False
    downhill = points[car] + [25, 0, -4]
    cloud = _cloud(np.vstack([points[near], downhill]), np.append(intensity[near], intensity[car]))
    # How full a cluster has to be is left out: this car is sampled as if it were near.
    result = replace(detector, density=None).detect(cloud)
    np.testing.assert_allclose(
        result.detections.boxes_m[_row(result, "car"), :2], np.add(_CAR_XY, [25, 0]), atol=0.1
    )


def test_a_cloud_without_intensity_still_has_classes(street: PointCloud) -> None:
    bare = _cloud(street.points_xyz, None)
    detector = prepare_detector([bare])
    result = detector.detect(bare)
    assert detector.intensity_scale is None
    assert np.isnan(result.detections.mean_intensity).all()
    assert "car" in result.detections.labels


def test_sizes_are_bounded_and_counted(street: PointCloud) -> None:
    values = {"cluster": {"max_points": 1000}, "max_range_m": 14.0}
    config = parse_settings(LidarConfig, values, "test")
    assert config.cluster.min_points == 10
    result = prepare_detector([street], config).detect(street)
    assert "car" not in result.detections.labels
    assert result.dropped["clusters above 1000 points"] >= 1
    assert result.dropped["points farther than 14 m"] > 0


def test_what_cannot_be_is_refused(detector: LidarDetector, street: PointCloud) -> None:
    other = PointCloud(
        topic="/other", stamp_ns=0, log_time_ns=0, frame="rear", points_xyz=street.points_xyz
    )
    with pytest.raises(GeometryError, match="'rear'"):
        detector.detect(other)
    with pytest.raises(InsufficientDataError, match="none of the first 1"):
        prepare_detector([_cloud(np.empty((0, 3)), None)])
    with pytest.raises(InsufficientDataError):
        prepare_detector([])
    with pytest.raises(ConfigError, match="height"):
        LidarConfig(sensor_height_m=40.0)
    with pytest.raises(ConfigError, match="sensor_height_m"):
        parse_settings(LidarConfig, {"ground": {"sensor_height_m": 1.0}}, "test")
    with pytest.raises(ConfigError, match="Did you mean 'tolerance_m'"):
        parse_settings(LidarConfig, {"cluster": {"tolerence_m": 1.0}}, "test")
    with pytest.raises(ConfigError, match="min_range_m"):
        parse_settings(LidarConfig, {"min_range_m": 200}, "test")


def test_ground_height_follows_a_slope() -> None:
    grid = np.stack(np.meshgrid(np.arange(-20, 20, 0.5), np.arange(-20, 20, 0.5)), -1)
    xy = grid.reshape(-1, 2)
    ground = np.column_stack([xy, 0.1 * xy[:, 0]])
    heights = ground_height_at(
        np.array([[10.0, 0.0], [-15.0, 3.0], [26.0, 0], [90.0, 0]]), ground, -7
    )
    np.testing.assert_allclose(heights[:2], [1.0, -1.5], atol=0.11)
    assert 1.0 < heights[2] < 2.0
    assert heights[3] == -7
    assert ground_height_at(np.zeros((2, 2)), np.empty((0, 3)), -1.5).tolist() == [-1.5, -1.5]


def test_fill_of_a_solid_wall_is_about_one() -> None:
    azimuth, elevation = np.meshgrid(
        np.deg2rad(np.arange(-60, 60, 0.25)), np.deg2rad(np.arange(-12, 12, 0.5))
    )
    at_20_m = 20 / np.cos(azimuth)
    wall = np.stack([at_20_m * np.cos(azimuth), at_20_m * np.sin(azimuth),
                     at_20_m * np.tan(elevation)], -1).reshape(-1, 3)  # fmt: skip
    density = estimate_density([wall])
    assert density[45] == pytest.approx(8.0, rel=0.05)
    assert np.isnan(density[0])
    car_sized = (np.abs(wall[:, 1]) < 2) & (np.abs(wall[:, 2]) < 0.8)
    solid = fit_boxes(wall[car_sized], np.zeros(car_sized.sum(), np.int32))
    assert fill_of(solid, density)[0] == pytest.approx(1.0, abs=0.15)
    thinned = fit_boxes(wall[car_sized][::5], np.zeros(len(wall[car_sized][::5]), np.int32))
    assert fill_of(thinned, density)[0] < 0.3


def test_density_is_that_of_one_cloud() -> None:
    points = np.random.default_rng(0).normal(size=(5000, 3))
    np.testing.assert_array_equal(estimate_density([points, points]), estimate_density([points]))


def _kitti(path: Path) -> PointCloud:
    values = np.fromfile(path, np.float32).reshape(-1, 4)
    return _cloud(values[:, :3], values[:, 3].copy())


def test_cars_of_a_real_scan(shared_data: Path) -> None:
    folder = shared_data / "scenes" / "av2" / "7fab2350" / "converted"
    cloud = _kitti(folder / "315966265259836000.bin")
    result = prepare_detector([cloud]).detect(cloud)
    boxes = result.detections.boxes_m
    cars = boxes[[label == "car" for label in result.detections.labels]]
    # Labelled cars that stand free within 30 m, by their centres.
    truth = [
        box["center"][:2]
        for box in json.loads((folder / "315966265259836000.boxes.json").read_text())
        if box["category"] == "REGULAR_VEHICLE"
        and box["num_interior_pts"] >= 150
        and np.hypot(*box["center"][:2]) < 30
    ]
    assert len(truth) >= 8
    hits = [np.linalg.norm(cars[:, :2] - place, axis=1).min() < 2.0 for place in truth]
    assert np.mean(hits) >= 0.7
    assert len(cars) <= 2.5 * len(truth)
