"""The parts around KISS-ICP: times of points, a part of a motion, surfaces, spread."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.samples import PointCloud
from percept.odometry.lidar.config import LidarOdometryConfig
from percept.odometry.lidar.kiss_parts import KissParts
from percept.odometry.lidar.point_times import ScanTimes, scan_times
from percept.odometry.lidar.screw import inverse_motion, part_of_motion
from percept.odometry.lidar.spread import WaySpread
from percept.odometry.lidar.surfaces import MapFit, SurfaceMap

_STAMP_NS = 1_700_000_000_123_456_789


def _cloud(offset_ns: list[int] | None) -> PointCloud:
    count = 3 if offset_ns is None else len(offset_ns)
    return PointCloud(
        topic="/points",
        stamp_ns=_STAMP_NS,
        log_time_ns=0,
        points_xyz=np.ones((count, 3), np.float32),
        offset_ns=None if offset_ns is None else np.array(offset_ns, dtype=np.int64),
    )


def _motion(turn: list[float], move: list[float]) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    matrix[:3, 3] = move
    return matrix


# ---- times


@pytest.mark.parametrize("shift", [0, -50_000_001, -99_999_999])
def test_the_end_of_a_scan_is_its_last_point_wherever_its_stamp_lies(shift: int) -> None:
    times = scan_times(_cloud([shift + 99_999_999, shift, shift + 50_000_000]))
    assert times.end_ns == _STAMP_NS + shift + 99_999_999
    assert times.offsets_s is not None
    assert times.offsets_s.tolist() == [0.099999999, 0.0, 0.05]
    assert times.duration_s == 0.099999999


@pytest.mark.parametrize(
    ("offsets", "words"),
    [(None, "no times"), ([7, 7, 7], "one time"), ([0, 2_000_000_000], "more than a second"),
     ([-(10**12), -(10**12) + 5], "more than a second"), ([], "no points")],
)  # fmt: skip
def test_times_that_cannot_be_used_are_named(offsets: list[int] | None, words: str) -> None:
    times = scan_times(_cloud(offsets))
    assert times.offsets_s is None
    assert words in times.note


def test_kiss_icp_brings_points_to_the_end_of_the_scan() -> None:
    parts = KissParts(LidarOdometryConfig(min_range_m=0.0))
    points = np.array([[10.0, 0, 0], [0, 10.0, 0], [0, 0, 10.0]])
    motion = _motion([0, 0, 0], [1.0, 0, 0])
    dense, _ = parts.thin_out(points, ScanTimes(0, 0.1, np.array([0.0, 0.05, 0.1])), motion)
    ordered = dense[np.argsort(dense[:, 2] * 100 + dense[:, 1])]
    np.testing.assert_allclose(
        ordered, np.array([[9, 0, 0], [-0.5, 10, 0], [0, 0, 10.0]]), atol=1e-12
    )
    still, _ = parts.thin_out(points, ScanTimes(0, 0.0, None), motion)
    assert sorted(still.sum(axis=1)) == pytest.approx([10, 10, 10])


# ---- motion


def test_parts_of_a_motion_follow_each_other() -> None:
    motion = _motion([0.2, -0.1, 0.7], [1.0, 2.0, -0.5])
    np.testing.assert_allclose(part_of_motion(motion, 1.0), motion, atol=1e-12)
    half = part_of_motion(motion, 0.5)
    np.testing.assert_allclose(half @ half, motion, atol=1e-12)
    np.testing.assert_allclose(part_of_motion(motion, -1.0), inverse_motion(motion), atol=1e-12)
    np.testing.assert_allclose(part_of_motion(np.eye(4), 3.0), np.eye(4), atol=1e-15)


def test_a_quarter_circle_is_halved_on_the_circle() -> None:
    quarter = _motion([0, 0, np.pi / 2], [1.0, 1.0, 0.0])
    half = part_of_motion(quarter, 0.5)
    np.testing.assert_allclose(half[:2, 3], [np.sin(np.pi / 4), 1 - np.cos(np.pi / 4)], atol=1e-12)


# ---- surfaces


def _room(rng: np.random.Generator, walls: tuple[int, ...], count: int) -> NDArray[np.float64]:
    """Return points on the two walls across each axis of a cube of 8 m."""
    parts = []
    for axis in walls:
        for side in (-4.0, 4.0):
            wall = rng.uniform(-4, 4, (count, 3))
            wall[:, axis] = side
            parts.append(wall)
    return np.concatenate(parts)


def test_a_scan_settles_on_the_walls_of_a_room() -> None:
    rng = np.random.default_rng(0)
    surfaces = SurfaceMap(_room(rng, (0, 1, 2), 3000), cell_m=1.0)
    true = _motion([0.02, 0.01, -0.03], [0.1, -0.05, 0.08])
    scan = (_room(rng, (0, 1, 2), 300) - true[:3, 3]) @ true[:3, :3]
    settled = surfaces.settle(scan, np.eye(4))
    np.testing.assert_allclose(settled, true, atol=2e-3)
    fit = surfaces.fit(scan, settled)
    assert fit.overlap > 0.95
    assert fit.residual_m < 0.005
    assert not fit.degenerate
    assert fit.hold.sum() == pytest.approx(1)


def test_a_corridor_holds_nothing_along_and_leaves_it_as_it_was() -> None:
    rng = np.random.default_rng(0)
    surfaces = SurfaceMap(_room(rng, (1, 2), 4000), cell_m=1.0)
    scan = _room(rng, (1, 2), 300)
    start = _motion([0, 0, 0], [0.2, 0.1, -0.1])
    settled = surfaces.settle(scan, start)
    np.testing.assert_allclose(settled[:3, 3], [0.2, 0, 0], atol=5e-3)
    fit = surfaces.fit(scan, settled)
    assert fit.degenerate
    assert abs(fit.weakest[0]) > 0.99
    assert fit.covariance[0, 0] > 100 * fit.covariance[1, 1]


def test_a_pose_that_would_go_far_stays_and_no_surface_is_no_fit() -> None:
    rng = np.random.default_rng(0)
    near, far = (_motion([0, 0, 0], [off_m] * 3) for off_m in (0.25, 0.35))  # 0.43 m and 0.61 m
    surfaces = SurfaceMap(_room(rng, (0, 1, 2), 3000), cell_m=1.0)
    scan = _room(rng, (0, 1, 2), 300)
    np.testing.assert_allclose(surfaces.settle(scan, near)[:3, 3], 0.0, atol=5e-3)
    assert surfaces.settle(scan, far) is far
    nothing = SurfaceMap(np.zeros((3, 3)), cell_m=1.0).fit(np.ones((50, 3)), np.eye(4))
    assert (nothing.overlap, nothing.points) == (0.0, 50)
    assert nothing.degenerate


# ---- spread


def test_the_spread_grows_with_the_way_and_with_what_is_guessed() -> None:
    rng = np.random.default_rng(0)
    room = SurfaceMap(_room(rng, (0, 1, 2), 3000), 1.0).fit(_room(rng, (0, 1, 2), 300), np.eye(4))
    spread = WaySpread()
    for _ in range(100):
        spread = spread.after(np.array([1.0, 0, 0]), 0.1, room)
    assert spread.sd_position_m == pytest.approx(0.5, rel=0.05)
    held = spread
    for _ in range(10):
        spread = spread.after(np.zeros(3), 0.1, MapFit.nothing())
    assert spread.guessed_m == pytest.approx(sum(0.2 * n * 0.1 for n in range(1, 11)))
    assert spread.after(np.zeros(3), 0.1, room).guessed_m == spread.guessed_m
    assert held.after_gap(np.zeros(3), 2.0).sd_position_m > 40
