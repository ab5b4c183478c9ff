"""Clusters against scikit-learn's DBSCAN(min_samples=1), which is exact single linkage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from percept.datasets.files.cloud_files import read_point_cloud
from percept.lidar.cluster import ClusterConfig, cluster_points
from percept.lidar.ground import GroundConfig, segment_ground

_cluster = pytest.importorskip("sklearn.cluster")
_metrics = pytest.importorskip("sklearn.metrics")

# Scan and height of the sensor: all kinds, dense and sparse, level and tilted.
_SCANS = {
    "odometry/kitti00_velodyne/000000.bin": 1.73,
    "scenes/kitti_object/training/velodyne/000001.bin": 1.73,
    "scenes/kitti_000008/000008.bin": 1.73,
    "scenes/av2/7fab2350/converted/315966265259836000.bin": 0.33,
    "scenes/sustechpoints/lidar/000965.pcd": 1.77,
    "lidar2lidar/opencalib_rig/0001/left.pcd": 1.8,
    "lidar2lidar/opencalib_rig/0001/top.pcd": 2.0,
    "lidar2lidar/av2_rig_7fab2350/sweep0/down.pcd": 1.8,
}


@pytest.mark.parametrize("scan", list(_SCANS))
def test_clusters_equal_dbscan(scan: str, shared_data: Path) -> None:
    points = read_point_cloud(shared_data / scan).points_xyz
    ground = segment_ground(points, GroundConfig(sensor_height_m=_SCANS[scan]))
    objects = points[~ground]
    labels = cluster_points(objects, ClusterConfig(tolerance_m=0.5))
    dbscan = _cluster.DBSCAN(eps=0.5, min_samples=1, algorithm="kd_tree")
    expected = dbscan.fit_predict(objects.astype(np.float64))
    assert labels.max() == expected.max() > 50
    assert _metrics.adjusted_rand_score(expected, labels) == 1.0


def test_other_tolerances_agree_too(shared_data: Path) -> None:
    points = read_point_cloud(shared_data / "scenes/kitti_000008/000008.bin").points_xyz
    for tolerance_m in (0.1, 0.33, 1.0):
        labels = cluster_points(points, ClusterConfig(tolerance_m=tolerance_m))
        dbscan = _cluster.DBSCAN(eps=tolerance_m, min_samples=1, algorithm="kd_tree")
        expected = dbscan.fit_predict(points.astype(np.float64))
        assert _metrics.adjusted_rand_score(expected, labels) == 1.0
