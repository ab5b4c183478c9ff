"""Kernels let go of the lock, and threads that share a detector do not disturb each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import numpy as np

from percept.core.samples import PointCloud
from percept.lidar.compiled import compiled
from percept.lidar.pipeline import LidarConfig
from percept.lidar.prepare import prepare_detector
from percept.lidar.result import ScanResult


def test_kernels_let_go_of_the_lock() -> None:
    def increased(value: int) -> int:
        return value + 1

    kernel = cast("Any", compiled(increased))
    assert kernel.targetoptions["nogil"]


def _street(seed: int) -> PointCloud:
    """Return a road with five boxes of points on it, 1.8 m below the sensor."""
    rng = np.random.default_rng(seed)
    road = rng.uniform([-30, -30, -1.82], [30, 30, -1.78], (6000, 3))
    middles = rng.uniform([-20, -20, -1.5], [20, 20, -0.5], (5, 1, 3))
    things = (middles + rng.uniform(-0.6, 0.6, (5, 80, 3))).reshape(-1, 3)
    points = np.concatenate([road, things]).astype(np.float32)
    return PointCloud(
        topic="/points", stamp_ns=seed, log_time_ns=seed, frame="lidar", points_xyz=points
    )


def _bits(result: ScanResult) -> tuple[bytes, ...]:
    found = result.detections
    columns = (result.ground, result.cluster_ids, found.boxes_m, found.confidences, found.points)
    return tuple(column.tobytes() for column in columns)


def test_one_detector_serves_many_threads() -> None:
    clouds = [_street(seed) for seed in range(6)]
    detector = prepare_detector(clouds[:2], LidarConfig(sensor_height_m=1.8))
    expected = [_bits(detector.detect(cloud)) for cloud in clouds]
    assert all(len(detector.detect(cloud).detections) for cloud in clouds)
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda cloud: _bits(detector.detect(cloud)), clouds * 5))
    assert found == expected * 5
