"""Rules of the search for a board, on clouds of a few points."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import (
    BoardInCloud,
    BoardInCloudConfig,
    NoBoardInCloud,
    find_boards,
)
from percept.calib.board_in_cloud.rectangle import fit_rectangle, measure_sides
from percept.calib.board_in_cloud.size import Rectangle, common_size
from percept.calib.board_in_cloud.static import moving_points
from percept.core.errors import ConfigError, GeometryError

_F64 = NDArray[np.float64]


def _plane_rays(step: float = 0.03) -> _F64:
    x, y = np.meshgrid(np.arange(-1, 1, step), np.arange(-1, 1, step))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def _met(rays: _F64, pose: tuple[float, float, float], size: tuple[float, float]) -> _F64:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    local = (rays[:, :2] - pose[:2]) @ np.array([[c, -s], [s, c]])
    return np.asarray((np.abs(local) < np.array(size) / 2).all(axis=1))


def _facing_plate(rng: np.random.Generator, distance: float = 3.0) -> _F64:
    """A plate of 0.8 x 0.6 m before a wall 2 m behind it, on a grid of 0.3 deg."""
    a = np.deg2rad(np.arange(-20, 20, 0.3))
    y, z = (np.tan(axis).ravel() for axis in np.meshgrid(a, a))
    on = (np.abs(y * distance) < 0.4) & (np.abs(z * distance) < 0.3)
    x = np.where(on, distance, distance + 2) + rng.normal(0, 0.005, len(y))
    return np.column_stack([x, y * x, z * x])


def test_a_rectangle_is_located_far_better_than_its_rays_are_apart() -> None:
    rays = _plane_rays()
    true = (0.037, -0.052, 0.31)
    hit = _met(rays, true, (0.8, 0.5)).astype(bool)
    fit = fit_rectangle(rays, hit, (0.8, 0.5), np.array([0.0, 0.0, 0.25]), 0.08)
    assert np.abs(fit.pose - true).max() < 0.004
    assert np.all(np.abs(fit.pose - true) < 3 * np.sqrt(np.diag(fit.covariance)))
    assert np.sqrt(fit.covariance[0, 0]) < 0.004


def test_without_rays_beside_it_the_rectangle_is_centred_between_equal_gaps() -> None:
    rays = _plane_rays(0.05) + np.array([0.025, 0.025, 0.0])
    hit = _met(rays, (0.0, 0.0, 0.0), (0.81, 0.61)).astype(bool)
    fit = fit_rectangle(rays[hit], hit[hit], (0.81, 0.61), np.array([0.02, -0.02, 0.0]), 0.08)
    assert np.abs(fit.pose[:2]).max() < 0.004


def test_wide_beams_bloom_and_do_not_shift() -> None:
    rays = _plane_rays(0.01)
    hit = _met(rays, (0.0, 0.0, 0.2), (0.82, 0.62)).astype(bool)
    fit = fit_rectangle(rays, hit, (0.8, 0.6), np.array([0.02, 0.01, 0.2]), 0.06)
    assert fit.bloom_m == pytest.approx(0.01, abs=0.003)
    assert np.abs(fit.pose[:2]).max() < 0.002


def test_sides_are_measured_with_the_gap_as_their_slack() -> None:
    rays = _plane_rays(0.04)
    hit = _met(rays, (0.0, 0.0, 0.0), (0.9, 0.5)).astype(bool)
    found, slack = measure_sides(rays, hit, (0.8, 0.6), np.zeros(3))
    assert np.all(np.abs(found - [0.9, 0.5]) <= slack + 1e-9)
    assert np.all(slack <= 0.0401)


def test_what_most_clouds_hit_does_not_move() -> None:
    rng = np.random.default_rng(0)
    wall = rng.uniform(0, 1, (400, 3)) * [0.05, 2.0, 2.0] + [5.0, 0, 0]
    clouds = [np.vstack([wall, [[2.0, float(k), 0.0]]]) for k in range(6)]
    for moving in moving_points(clouds):
        assert not moving[:400].any()
        assert moving[400]


def test_a_plate_is_found_and_its_frame_faces_the_sensor() -> None:
    cloud = _facing_plate(np.random.default_rng(0))
    (board,) = find_boards([cloud], ["one"], (0.8, 0.6))
    assert isinstance(board, BoardInCloud)
    assert board.name == "one"
    assert board.T_lidar_plate[:3, 3] == pytest.approx([3.0, 0.0, 0.0], abs=0.006)
    assert board.T_lidar_plate[0, 2] < -0.999
    assert abs(board.T_lidar_plate[1, 0]) > 0.999  # x along the width, which lies along y here
    assert np.linalg.det(board.T_lidar_plate[:3, :3]) == pytest.approx(1.0)
    assert board.size_found_m == pytest.approx((0.8, 0.6), abs=0.02)
    assert board.rms_m == pytest.approx(0.005, rel=0.2)
    assert np.linalg.eigvalsh(board.covariance).min() > 0
    (swapped,) = find_boards([cloud], ["one"], (0.6, 0.8))
    assert isinstance(swapped, BoardInCloud)
    assert abs(swapped.T_lidar_plate[2, 0]) > 0.999


def test_results_repeat_exactly() -> None:
    cloud = _facing_plate(np.random.default_rng(1))
    first, second = (find_boards([cloud], ["one"], (0.8, 0.6))[0] for _ in range(2))
    assert isinstance(first, BoardInCloud)
    assert isinstance(second, BoardInCloud)
    assert np.array_equal(first.T_lidar_plate, second.T_lidar_plate)


def test_the_input_stays_as_it_is_and_progress_counts_clouds() -> None:
    cloud = _facing_plate(np.random.default_rng(2))
    before = cloud.copy()
    done: list[float] = []
    find_boards([cloud, cloud], ["a", "b"], (0.8, 0.6), progress=done.append)
    assert np.array_equal(cloud, before)
    assert done == [1, 2]


@pytest.mark.parametrize(
    ("cloud", "reason"),
    [
        (np.zeros((0, 3)), "empty cloud"),
        (np.full((100, 3), np.nan), "0 of 100 points lie between 0.5 and 20 m"),
        (np.full((100, 3), 400.0), "0 of 100 points lie between 0.5 and 20 m"),
        (np.full((100, 3), 2.0), "no plane of 0.8 x 0.6 m"),
    ],
)
def test_a_cloud_without_a_board_says_why(cloud: _F64, reason: str) -> None:
    good = _facing_plate(np.random.default_rng(3))
    none, board = find_boards([cloud, good], ["bad", "good"], (0.8, 0.6))
    assert none == NoBoardInCloud("bad", reason)
    assert isinstance(board, BoardInCloud)


def test_the_best_other_rectangle_is_named() -> None:
    cloud = _facing_plate(np.random.default_rng(4))
    (none,) = find_boards([cloud], ["one"], (1.1, 0.8))
    assert isinstance(none, NoBoardInCloud)
    assert none.reason.startswith("no plane of 1.1 x 0.8 m; the best is 0.79 x 0.60 m")
    assert "is the plate's size right?" not in none.reason  # one cloud is no evidence


def test_a_size_is_common_when_half_of_the_clouds_share_it() -> None:
    shared = [Rectangle((0.80 + 0.01 * k, 0.6), 100) for k in range(4)]
    others = [Rectangle((1.5, 0.3), 40), Rectangle((2.0, 0.5), 40)]
    common = common_size([*shared, *others])
    assert common is not None
    assert common[0].size_m == pytest.approx((0.815, 0.6))
    assert common[1] == 4
    assert common_size(shared[:2]) is None
    assert common_size([*shared[:1], *others]) is None


def test_bad_arguments_are_named() -> None:
    with pytest.raises(GeometryError, match="names"):
        find_boards([np.zeros((5, 3))], [], (0.8, 0.6))
    with pytest.raises(GeometryError, match=r"flat\.pcd"):
        find_boards([np.zeros((5, 2))], ["flat.pcd"], (0.8, 0.6))
    for size in ((0.0, 0.6), (800.0, 600.0), (float("nan"), 0.6)):
        with pytest.raises(ConfigError, match="cannot be looked for"):
            find_boards([], [], size)
    assert find_boards([], [], (0.8, 0.6)) == []
    assert BoardInCloudConfig().max_side_error == 0.10
