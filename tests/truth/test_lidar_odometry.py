"""LiDAR odometry in simple places, and on real scans: the truth comes back, or it says why not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lidar_drives import PERIOD_NS, START_NS, drive, field, scans, street, tunnel
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.errors import GeometryError, InsufficientDataError
from percept.core.results import Verdict
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.odometry.drift import measure_drift
from percept.odometry.lidar import (
    LidarOdometry,
    LidarOdometryConfig,
    LidarTrajectory,
    lidar_trajectory,
)
from percept.odometry.lidar.kiss_parts import KissParts
from percept.odometry.lidar.point_times import scan_times
from percept.odometry.lidar.screw import part_of_motion

_DRIVE = drive(8.0, 0.05)
_F = NDArray[np.float64]


@pytest.fixture(scope="module")
def street_scans() -> list[PointCloud]:
    return scans(street(np.random.default_rng(1)), _DRIVE, 16)[0]


def _errors(found: LidarTrajectory) -> _F:
    """Return the distances (N,) from the truth, with the first poses on each other."""
    seconds = (found.trajectory.stamps_ns - START_NS) / 1e9
    true = _DRIVE(seconds)
    relative = np.linalg.inv(true[0]) @ true
    errors: _F = np.linalg.norm((found.trajectory.matrices - relative)[:, :3, 3], axis=1)
    return errors


def test_a_drive_comes_back_at_the_end_of_each_scan(street_scans: list[PointCloud]) -> None:
    found = lidar_trajectory(street_scans)
    assert found.verdict is Verdict.GOOD
    assert found.scan_stamps_ns.tolist() == [START_NS + n * PERIOD_NS for n in range(16)]
    ends = [c.stamp_ns + int(np.max(c.offset_ns)) for c in street_scans if c.offset_ns is not None]
    assert found.trajectory.stamps_ns.tolist() == ends
    errors = _errors(found)
    # A pose that was that of the beginning or the middle would be 0.4 m off, at any time but
    # the first: the drive turns, and the ends of scans are not evenly spaced.
    assert errors.max() < 0.03
    assert (errors < 3 * found.sd_position_m + 0.01).all()
    assert np.all(np.diff(found.sd_position_m[3:]) > 0)


def test_scans_without_times_work_and_say_so(street_scans: list[PointCloud]) -> None:
    found = lidar_trajectory([replace(cloud, offset_ns=None) for cloud in street_scans[:6]])
    assert "points have no times: no deskewing" in found.notes
    assert found.trajectory.stamps_ns.tolist() == found.scan_stamps_ns.tolist()


def test_points_that_all_have_one_time_do_no_harm(street_scans: list[PointCloud]) -> None:
    same = [replace(c, offset_ns=np.full(len(c), 5, np.int64)) for c in street_scans[:3]]
    found = lidar_trajectory(same)
    assert "points have one time" in "; ".join(found.notes)
    assert found.trajectory.stamps_ns.tolist() == [c.stamp_ns + 5 for c in same]


def test_scans_of_a_sensor_give_the_poses_of_the_vehicle(street_scans: list[PointCloud]) -> None:
    T_base_top = Transform.from_quat_xyzw("base_link", "top", [1.5, 0.3, 1.8], [0, 0, 0.6, 0.8])
    seen = [replace(c.transformed(T_base_top.inverse())) for c in _in_base(street_scans[:8])]
    found = lidar_trajectory(seen, T_base_sensor=T_base_top)
    assert (found.trajectory.target, found.trajectory.source) == ("odom", "base_link")
    assert _errors(found).max() < 0.05
    with pytest.raises(GeometryError, match="frame 'other'"):
        lidar_trajectory([*seen, replace(seen[-1], frame="other")], T_base_sensor=T_base_top)


def _in_base(clouds: list[PointCloud]) -> list[PointCloud]:
    return [replace(cloud, frame="base_link") for cloud in clouds]


def test_missing_scans_do_no_harm(street_scans: list[PointCloud]) -> None:
    kept = [c for n, c in enumerate(street_scans) if n not in (5, 6, 10)]
    found = lidar_trajectory(kept)
    assert found.verdict is Verdict.GOOD
    assert _errors(found).max() < 0.05


def test_a_scan_that_does_not_fit_is_left_out_and_named(street_scans: list[PointCloud]) -> None:
    rng = np.random.default_rng(0)
    noise = rng.uniform(-40, 40, (len(street_scans[7]), 3)).astype(np.float32)
    broken = [*street_scans[:7], replace(street_scans[7], points_xyz=noise), *street_scans[8:]]
    broken[9] = street_scans[9].select(np.arange(20))
    found = lidar_trajectory([*broken, street_scans[0]])
    assert found.verdict is Verdict.BAD  # two of sixteen are more than a tenth
    assert [q.scan for q in found.quality if q.failure] == [7, 9]
    assert "scans 7, 9" in found.why[0]
    assert len(found.trajectory) == 14
    assert found.dropped["scan that is no later than the one before"] == 1
    assert found.dropped["scan that did not register: too few points"] == 1
    assert found.dropped.total() == 3
    assert _errors(found).max() < 0.05


def test_a_lost_way_begins_anew_behind_a_gap(street_scans: list[PointCloud]) -> None:
    far = [
        replace(c, points_xyz=c.points_xyz + np.array([0, 0, 30], np.float32))
        for c in street_scans[5:9]
    ]
    config = LidarOdometryConfig(restart_after=1)
    found = lidar_trajectory([*street_scans[:5], *far], config=config)
    assert found.verdict is Verdict.BAD
    assert [q.scan for q in found.quality if q.begins_map] == [0, 6]
    stamps_ns = found.trajectory.stamps_ns
    assert found.trajectory.gaps_ns.tolist() == [[stamps_ns[4], stamps_ns[5]]]
    assert found.trajectory.at(int(stamps_ns[4]) + 1) is None
    assert found.sd_position_m[5] > found.sd_position_m[4] + 2
    assert not found.quality[7].failure
    assert "the way was lost 1 x" in "; ".join(found.why)


@pytest.mark.parametrize("place", [tunnel, field])
def test_a_place_that_holds_nothing_is_called_so(place: object) -> None:
    world = tunnel(np.random.default_rng(1)) if place is tunnel else field(np.random.default_rng(1))
    found = lidar_trajectory(scans(world, _DRIVE, 6)[0])
    assert found.verdict is Verdict.BAD
    assert all(q.degenerate for q in found.quality[1:])
    assert "no surface holds" in found.why[0]
    assert _errors(found)[-1] < 3 * found.sd_position_m[-1]


def test_the_same_scans_give_the_same_poses(street_scans: list[PointCloud]) -> None:
    first, second = (lidar_trajectory(street_scans[:5]) for _ in range(2))
    assert np.array_equal(first.trajectory.matrices, second.trajectory.matrices)


def test_too_few_scans_are_refused(street_scans: list[PointCloud]) -> None:
    with pytest.raises(InsufficientDataError, match="0 LiDAR scans"):
        lidar_trajectory([])
    with pytest.raises(InsufficientDataError, match="points enough"):
        lidar_trajectory([c.select(np.arange(9)) for c in street_scans[:3]])


# ---- real scans


def _keyframes(folder: Path) -> tuple[list[PointCloud], list[Transform]]:
    clouds, places = [], []
    lines = (folder / "graph.txt").read_text().splitlines()
    for number, line in enumerate(lines):
        values = [float(word) for word in line.split()[1:]]
        places.append(Transform.from_quat_xyzw("odom", "velodyne", values[:3], values[3:]))
        points = np.fromfile(folder / f"{number:06d}" / "points.bin", np.float32).reshape(-1, 3)
        stamp_ns = (number + 1) * 10**9
        clouds.append(
            PointCloud(
                topic="/v", stamp_ns=stamp_ns, log_time_ns=0, frame="velodyne", points_xyz=points
            )
        )
    return clouds, places


def test_keyframes_far_apart_fail_by_themselves_and_register_from_their_graph(
    shared_data: Path,
) -> None:
    clouds, places = _keyframes(shared_data / "odometry" / "kitti07_dump")
    alone = lidar_trajectory(clouds)
    assert alone.verdict is Verdict.BAD
    assert [q.scan for q in alone.quality if q.failure] == [1, 2, 3, 4]
    assert "scans 1, 2, 3, 4" in alone.why[0]

    guided = LidarOdometry()
    for cloud, place in zip(clouds, places, strict=True):
        guided.push(cloud, guess=place)
    found = guided.result()
    assert found.verdict is Verdict.GOOD
    for matrix, place in zip(found.trajectory.matrices, places, strict=True):
        off = np.linalg.inv(place.matrix) @ matrix
        assert np.linalg.norm(off[:3, 3]) < 0.1
        assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < 0.3


def test_real_scans_of_a_drive_register(shared_data: Path) -> None:
    folder = shared_data / "odometry" / "kitti00_velodyne"
    clouds = [
        PointCloud(
            topic="/v",
            stamp_ns=n * 103_600_000,
            log_time_ns=0,
            frame="velodyne",
            points_xyz=np.fromfile(folder / f"{n:06d}.bin", np.float32).reshape(-1, 4)[:, :3],
        )
        for n in range(4)
    ]
    found = lidar_trajectory(clouds)
    assert found.verdict is Verdict.GOOD
    steps = np.diff(found.trajectory.matrices[:, :3, 3], axis=0)
    assert np.linalg.norm(steps, axis=1) == pytest.approx([0.70] * 3, abs=0.06)


@pytest.mark.parametrize("number", ["00", "01"])
def test_the_times_of_real_points_take_the_motion_out(shared_data: Path, number: str) -> None:
    """The recording has raw points, their times, and the same points deskewed by an IMU.

    Those are given in the IMU's frame at the first point: T_imu_lidar turns by half a circle.
    """
    folder = shared_data / "odometry" / "newer_college_deskew"
    raw, given = (
        np.fromfile(folder / f"{kind}_{number}.bin", np.float32).reshape(-1, 3).astype(float)
        for kind in ("raw", "deskewed")
    )
    seconds = np.fromfile(folder / f"times_{number}.bin", np.float32).astype(float)
    cloud = PointCloud(
        topic="/os1",
        stamp_ns=START_NS,
        log_time_ns=0,
        points_xyz=raw.astype(np.float32),
        offset_ns=np.round(seconds * 1e9).astype(np.int64),
    )
    times = scan_times(cloud)
    assert times.duration_s == pytest.approx(0.1, abs=2e-3)
    at_start = (given - [-0.006, 0.012, -0.029]) * [-1.0, -1.0, 1.0]
    # The motion is that of the last hundredth second; all the points before test the times.
    late = seconds > seconds.max() - 0.01
    motion = part_of_motion(
        _rigid(raw[late], at_start[late]), seconds.max() / float(seconds[late].mean())
    )
    parts = KissParts(LidarOdometryConfig(min_range_m=0.0))
    early = ~late & (seconds > 0.01)
    moved = parts.deskewed(raw, times, motion)
    back = moved @ motion[:3, :3].T + motion[:3, 3]
    ours = np.linalg.norm(back - at_start, axis=1)[early]
    undone = np.linalg.norm(raw - at_start, axis=1)[early]
    assert ours.mean() < 0.2 * undone.mean()
    assert undone.mean() > 0.5


def _rigid(source: _F, target: _F) -> _F:
    """Return the motion (4, 4) that lays points over others (Umeyama 1991)."""
    a, b = target - target.mean(axis=0), source - source.mean(axis=0)
    left, _, right = np.linalg.svd(a.T @ b)
    motion = np.eye(4)
    motion[:3, :3] = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    motion[:3, 3] = target.mean(axis=0) - motion[:3, :3] @ source.mean(axis=0)
    return motion


def test_the_drift_of_the_drive_is_told(street_scans: list[PointCloud]) -> None:
    _, true = scans(np.zeros((4, 3)), _DRIVE, 16)
    drift = measure_drift(lidar_trajectory(street_scans).trajectory, true)
    assert drift.translation_percent is not None
    assert drift.translation_percent < 0.5
