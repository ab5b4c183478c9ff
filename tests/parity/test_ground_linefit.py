"""Ground labels against the C++ implementation, point by point, on all real scans."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.datasets import read_point_cloud
from percept.lidar.ground import GroundConfig, segment_ground

linefit = pytest.importorskip("linefit")

_TOML = Path(__file__).with_name("linefit.toml.in").read_text()

_CONFIGS = {
    "defaults": GroundConfig(sensor_height_m=1.73),
    "ego frame": GroundConfig(sensor_height_m=0.33),
    "tight": GroundConfig(
        sensor_height_m=1.73,
        bins=120,
        r_max_m=50.0,
        max_dist_to_line_m=0.05,
        max_slope=0.3,
        max_fit_error_m=0.05,
        long_threshold_m=1.0,
        max_long_height_m=0.1,
        max_start_height_m=0.2,
        line_search_angle_rad=0.1,
    ),
    "loose": GroundConfig(
        sensor_height_m=1.9,
        segments=181,
        bins=64,
        r_min_m=2.7,
        r_max_m=120.0,
        min_slope=0.01,
        max_slope=1.0,
        max_fit_error_m=0.5,
        max_start_height_m=2.0,
        line_search_angle_rad=1.0,
    ),
}


def _scans(shared_data: Path) -> Iterator[tuple[str, NDArray[np.float32]]]:
    for pattern in (
        "odometry/kitti00_velodyne/*.bin",
        "scenes/*/training/velodyne/*.bin",
        "scenes/*/*.bin",
        "scenes/av2/*/converted/*.bin",
        "scenes/*/lidar/*.pcd",
        "lidar2lidar/**/*.pcd",
        "lidar2lidar/**/*.ply",
    ):
        for path in sorted(shared_data.glob(pattern)):
            yield path.relative_to(shared_data).as_posix(), read_point_cloud(path).points_xyz
    for path in sorted(shared_data.glob("odometry/kitti07_dump/*/points.bin")):
        yield path.parent.name, np.fromfile(path, np.float32).reshape(-1, 3)


@pytest.mark.parametrize("name", list(_CONFIGS))
def test_labels_equal_linefit(name: str, shared_data: Path, tmp_path: Path) -> None:
    config = _CONFIGS[name]
    settings = tmp_path / "linefit.toml"
    settings.write_text(_TOML.format(c=config))
    engine = linefit.ground_seg(str(settings))
    scans = ground = 0
    for scan, points in _scans(shared_data):
        expected = engine.run(points).astype(bool)
        different = int((segment_ground(points, config) != expected).sum())
        assert different == 0, f"{scan}: {different} of {len(points)} labels differ"
        scans += 1
        ground += int(expected.sum())
    assert scans >= 20
    assert ground > 50_000  # labels that are all False would agree as well


def test_ground_of_a_labelled_drive(shared_data: Path) -> None:
    # Labels of the data set's own map; 255 is unknown. The vehicle itself lies within 2.7 m.
    for path in sorted((shared_data / "scenes/av2").glob("*/converted/*.bin")):
        points = read_point_cloud(path).points_xyz
        truth = np.fromfile(path.with_suffix(".ground.u8"), np.uint8)
        counts = (np.hypot(points[:, 0], points[:, 1]) > 2.7) & (truth < 2)
        labels = segment_ground(points, GroundConfig(sensor_height_m=0.33))
        hits = (labels & (truth == 1) & counts).sum()
        f1 = 2.0 * hits / (labels[counts].sum() + (truth[counts] == 1).sum())
        assert f1 >= 0.94
