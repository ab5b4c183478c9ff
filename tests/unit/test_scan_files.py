"""Files of points: all LiDARs in the base frame, as they were at the keyframe's time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.datasets.labelling.scan_files import write_scan


def _moved(source: str, target: str, x: float) -> Transform:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return Transform(target, source, matrix)


def _cloud(*rows: tuple[float, float, float], intensity: bool = True) -> PointCloud:
    return PointCloud(
        topic="/lidar", stamp_ns=0, log_time_ns=0, frame="lidar",
        points_xyz=np.array(rows, np.float32).reshape(-1, 3),
        intensity=np.full(len(rows), np.nan if len(rows) > 1 else 7.0, np.float32)
        if intensity
        else None,
    )  # fmt: skip


def test_points_are_moved_by_place_and_motion(tmp_path: Path) -> None:
    path = tmp_path / "scan.bin"
    place, motion = _moved("lidar", "base_link", 2.0), _moved("base_link", "base_link", -0.5)
    clouds = [_cloud((1, 2, 3)), _cloud((0, 0, 0), (4, 5, 6)), _cloud((9, 9, 9), intensity=False)]
    count = write_scan(path, clouds, [place] * 3, [None, motion, None])
    rows = np.fromfile(path, "<f4").reshape(-1, 4)
    assert count == len(rows) == 4
    expected = np.array([[3, 2, 3, 7], [1.5, 0, 0, 0], [5.5, 5, 6, 0], [11, 9, 9, 0]])
    np.testing.assert_allclose(rows, expected)


def test_no_points_are_an_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "scan.bin"
    assert write_scan(path, [], [], []) == 0
    assert path.read_bytes() == b""
