"""Sensor height and tilt from clouds alone, against known worlds and real sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import ConfigError, GeometryError
from percept.core.transform import rotation_from_rpy
from percept.datasets.files.cloud_files import read_point_cloud
from percept.lidar.mounting import check_sensor_height, estimate_mounting

Cloud = NDArray[np.float32]


def _street(height_m: float, seed: int = 0) -> NDArray[np.float64]:
    """Return ground, two house fronts, car roofs and a bush around a sensor, z up, noisy."""
    random = np.random.default_rng(seed)
    r = 3.0 + 30.0 * random.random(6000) ** 2
    azimuth = random.uniform(-np.pi, np.pi, 6000)
    ground = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), np.zeros(6000)], axis=1)
    fronts = random.uniform([-30.0, -9.0, 0.0], [30.0, -9.0, 6.0], (3000, 3))
    fronts[::2, 1] = 11.0
    roofs = random.uniform([4.0, 3.0, 1.45], [20.0, 5.0, 1.5], (800, 3))
    bush = random.normal([8.0, -6.0, 1.0], 0.7, (500, 3))
    world = np.concatenate([ground[np.abs(ground[:, 1] - 1.0) < 10.0], fronts, roofs, bush])
    return world - [0.0, 0.0, height_m] + random.normal(0.0, 0.02, world.shape)


def _seen_by(world: NDArray[np.float64], rotation_level_sensor: NDArray[np.float64]) -> Cloud:
    return (world @ rotation_level_sensor).astype(np.float32)


@pytest.mark.parametrize("height_m", [0.0, 0.33, 1.73, 3.2, 4.8])
def test_height_of_a_level_sensor(height_m: float) -> None:
    mounting = estimate_mounting([_street(height_m)])
    assert mounting.height_m == pytest.approx(height_m, abs=0.02)
    assert mounting.tilt_deg < 0.3
    assert not mounting.upside_down
    assert mounting.inlier_share > 0.3
    assert mounting.sd_height_m < 0.08


@pytest.mark.parametrize(
    "rpy_deg", [(5.0, 0.0, 0.0), (0.0, -12.0, 0.0), (14.0, 13.0, 70.0), (3.0, 19.0, -120.0)]
)
@pytest.mark.parametrize("flip", [False, True])
def test_tilt_and_upside_down_are_levelled(rpy_deg: tuple[float, ...], flip: bool) -> None:  # noqa: FBT001
    world = _street(1.9)
    rotation = rotation_from_rpy(*np.radians(rpy_deg))
    if flip:
        rotation = rotation @ np.diag([1.0, -1.0, -1.0])
    cloud = _seen_by(world, rotation)
    mounting = estimate_mounting([cloud], frame="left")
    assert mounting.height_m == pytest.approx(1.9, abs=0.03)
    assert mounting.upside_down == flip
    tilt_deg = np.degrees(np.arccos(abs(rotation[2, 2])))
    assert mounting.tilt_deg == pytest.approx(tilt_deg, abs=0.4)
    level = mounting.T_level_sensor
    assert (level.target, level.source) == ("left_level", "left")
    np.testing.assert_array_equal(level.translation_m, 0.0)
    np.testing.assert_allclose(level.apply(cloud)[:, 2], world[:, 2], atol=0.25)
    # The level x axis is the sensor's, laid flat: headings keep their meaning.
    assert level.rotation[1, 0] == pytest.approx(0.0, abs=1e-9)
    assert level.rotation[0, 0] > 0.9


def test_several_clouds_are_averaged_and_their_spread_is_told() -> None:
    clouds = [_street(1.73 + offset, seed) for seed, offset in enumerate((-0.04, 0.0, 0.04))]
    mounting = estimate_mounting(clouds)
    assert mounting.height_m == pytest.approx(1.73, abs=0.02)
    assert mounting.sd_height_m == pytest.approx(0.04, abs=0.01)
    assert mounting.clouds_used == 3


def test_a_road_on_a_dam_wins_over_the_fields_below() -> None:
    random = np.random.default_rng(4)
    road = random.uniform([6.0, -6.0, -3.1], [80.0, 6.0, -3.1], (2000, 3))
    fields = random.uniform([15.0, -40.0, -5.6], [80.0, 40.0, -5.6], (6000, 3))
    cloud = np.concatenate([road, fields[np.abs(fields[:, 1]) > 9.0]])
    noisy = cloud + random.normal(0.0, 0.03, cloud.shape)
    assert estimate_mounting([noisy]).height_m == pytest.approx(3.1, abs=0.05)


def test_under_a_ceiling_the_floor_is_the_ground() -> None:
    random = np.random.default_rng(5)
    floor = random.uniform([-25.0, -25.0, -1.9], [25.0, 25.0, -1.9], (5000, 3))
    ceiling = floor + np.array([0.0, 0.0, 2.6])
    mounting = estimate_mounting([np.concatenate([floor, ceiling])])
    assert mounting.height_m == pytest.approx(1.9, abs=0.02)
    assert not mounting.upside_down


def test_what_has_much_ground_below_it_is_not_the_ground() -> None:
    # A deck 0.8 m under the sensor fills more of the near surface than the road around it.
    steps = np.arange(-14.0, 14.0, 0.5) + 0.25
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    apart = np.maximum(np.abs(x), np.abs(y))
    cloud = np.column_stack([x, y, np.where(apart < 8.0, -0.8, -1.8)])[apart > 2.5]
    noisy = cloud + np.random.default_rng(0).normal(0.0, 0.02, cloud.shape)
    assert estimate_mounting([noisy]).height_m == pytest.approx(1.8, abs=0.05)


def test_the_input_is_not_changed_and_the_answer_repeats() -> None:
    cloud = _street(1.7).astype(np.float32)
    kept = cloud.copy()
    first, second = estimate_mounting([cloud]), estimate_mounting([cloud])
    np.testing.assert_array_equal(cloud, kept)
    assert first.height_m == second.height_m


@pytest.mark.parametrize(
    "cloud",
    [
        np.empty((0, 3)),
        np.zeros((1000, 3)),
        np.random.default_rng(6).uniform(-20.0, 20.0, (4000, 3)),
        np.random.default_rng(7).uniform([10.0, -20.0, -2.0], [10.1, 20.0, 8.0], (4000, 3)),
        _street(1.9) @ rotation_from_rpy(0.0, np.radians(45.0), 0.0),
    ],
)
def test_no_ground_plane_is_refused_with_a_remedy(cloud: NDArray[np.float64]) -> None:
    with pytest.raises(GeometryError, match=r"no ground plane .*--sensor-height or a rig"):
        estimate_mounting([cloud], frame="left")


def test_no_clouds_and_a_crane_are_refused() -> None:
    with pytest.raises(GeometryError, match="no ground plane"):
        estimate_mounting([])
    with pytest.raises(GeometryError, match=r"9\.\d+ m under the sensor"):
        estimate_mounting([_street(9.2)])


@pytest.mark.parametrize("height_m", [-0.3, 5.1, float("nan"), float("inf")])
def test_impossible_heights_are_refused(height_m: float) -> None:
    with pytest.raises(ConfigError, match="0 to 5 m"):
        check_sensor_height(height_m)


@pytest.mark.parametrize("height_m", [0.0, 0.33, 1.73, 5.0])
def test_possible_heights_pass(height_m: float) -> None:
    assert check_sensor_height(height_m) == height_m


@pytest.mark.parametrize(
    ("scans", "height_m", "upside_down"),
    [
        ("odometry/kitti00_velodyne/*.bin", 1.75, False),
        ("scenes/kitti_object/training/velodyne/*.bin", 1.73, False),
        ("scenes/av2/*/converted/*.bin", 0.34, False),
        ("lidar2lidar/av2_rig_7fab2350/sweep0/up.pcd", 2.0, False),
        ("lidar2lidar/av2_rig_7fab2350/sweep0/down.pcd", 1.89, True),
        ("lidar2lidar/opencalib_rig/000*/top*.pcd", 2.1, False),
    ],
)
def test_real_sensors(scans: str, height_m: float, upside_down: bool, shared_data: Path) -> None:  # noqa: FBT001
    clouds = [read_point_cloud(path).points_xyz for path in sorted(shared_data.glob(scans))]
    mounting = estimate_mounting(clouds)
    assert mounting.height_m == pytest.approx(height_m, abs=0.05)
    assert mounting.upside_down == upside_down
    assert mounting.tilt_deg < 3.0
    assert mounting.clouds_used == len(clouds)


def test_a_sensor_tilted_by_45_deg_is_refused(shared_data: Path) -> None:
    path = shared_data / "lidar2lidar/opencalib_rig/0001/left.pcd"
    with pytest.raises(GeometryError, match="no ground plane"):
        estimate_mounting([read_point_cloud(path).points_xyz])
