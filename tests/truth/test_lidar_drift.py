"""Drift of LiDAR odometry over more than 100 m of the synthetic street, without GNSS."""

from __future__ import annotations

import pytest

from percept.core.results import Verdict
from percept.core.samples import PointCloud
from percept.core.trajectory import Trajectory
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.odometry import lidar_trajectory
from percept.odometry.drift import measure_drift


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 6])
def test_drift_is_under_one_percent_over_100_m(seed: int) -> None:
    drive = Drive(DriveConfig(seed=seed, seconds=15.0, cameras=()))
    clouds = (
        sample
        for sample in drive.samples()
        if isinstance(sample, PointCloud) and sample.topic.startswith("/lidar_top")
    )
    found = lidar_trajectory(clouds, T_base_sensor=drive.rig.lidars()["lidar_top"].T_base_sensor)
    assert found.verdict is Verdict.GOOD
    stamps_ns = found.trajectory.stamps_ns
    truth = Trajectory("map", "base_link", stamps_ns, drive.ego.poses(drive.ego.seconds(stamps_ns)))
    drift = measure_drift(found.trajectory, truth)
    assert drift.way_m > 110
    over_100_m = next(s for s in drift.stretches if s.length_m == 100)
    assert over_100_m.count >= 3
    assert over_100_m.translation_percent < 1.0
    assert drift.end_m < 0.01 * drift.way_m
