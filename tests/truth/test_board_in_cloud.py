"""A plate in a room, seen by ideal spinning LiDARs: is it where it was put, as well as claimed?"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import BoardInCloud, NoBoardInCloud, find_boards

_F64 = NDArray[np.float64]
_SIZE = (0.85, 0.61)
_ROOM = [  # normal, distance: floor, ceiling, four walls
    ((0, 0, 1), -1.6), ((0, 0, 1), 4.0), ((1, 0, 0), 14.0), ((1, 0, 0), -8.0),
    ((0, 1, 0), 9.0), ((0, 1, 0), -7.0),
]  # fmt: skip
_Box = tuple[_F64, _F64]


def _beams(count: int, low_deg: float, high_deg: float) -> _F64:
    elevation = np.deg2rad(np.linspace(low_deg, high_deg, count))
    azimuth = np.deg2rad(np.arange(-45, 45, 0.2))
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1).reshape(-1, 3)


def _scan(
    rays: _F64,
    T_lidar_plate: _F64,
    size: tuple[float, float],
    rng: np.random.Generator,
    boxes: tuple[_Box, ...] = (),
    planes: list[tuple[tuple[int, int, int], float]] = _ROOM,
) -> _F64:
    """Cast rays at planes, boxes and the plate; 1 cm of range noise; nothing beyond 60 m."""
    best = np.full(len(rays), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for normal, offset in planes:
            t = offset / (rays @ np.array(normal, float))
            best = np.minimum(best, np.where(t > 0, t, np.inf))
        for low, high in boxes:
            enter = np.minimum(low / rays, high / rays).max(axis=1)
            leave = np.maximum(low / rays, high / rays).min(axis=1)
            best = np.minimum(best, np.where((enter < leave) & (enter > 0), enter, np.inf))
        normal_ = T_lidar_plate[:3, 2]
        t = (normal_ @ T_lidar_plate[:3, 3]) / (rays @ normal_)
        x, y = ((rays * t[:, None] - T_lidar_plate[:3, 3]) @ T_lidar_plate[:3, :2]).T
    on = (t > 0) & (t < best) & (np.abs(x) < size[0] / 2) & (np.abs(y) < size[1] / 2)
    best = np.where(on, t, best)
    noisy = best + rng.normal(0, 0.01, len(best))
    return np.asarray((rays * noisy[:, None])[best < 60], np.float64)


def _plate(middle: _F64, yaw: float, tilt: float = 0.0, roll: float = 0.0) -> _F64:
    z = -np.array([np.cos(yaw) * np.cos(tilt), np.sin(yaw) * np.cos(tilt), -np.sin(tilt)])
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    T = np.eye(4)
    T[:3, 0] = np.cos(roll) * x + np.sin(roll) * y
    T[:3, 1] = np.cross(z, T[:3, 0])
    T[:3, 2] = z
    T[:3, 3] = middle
    return T


def _random_plate(range_m: float, rng: np.random.Generator) -> _F64:
    azimuth = rng.uniform(-0.4, 0.4)
    middle = range_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    middle[2] = rng.uniform(-0.2, 0.2)
    return _plate(
        middle, azimuth + rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.4), rng.uniform(-1.5, 1.5)
    )


def _error(found: _F64, true: _F64, turns: int = 2) -> _F64:
    """Return (6,) small rotation (rad) and shift (m) in the found plate's frame, up to symmetry."""
    errors = []
    for k in range(turns):
        c, s = np.cos(2 * np.pi * k / turns), np.sin(2 * np.pi * k / turns)
        turned = true[:3, :3] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        D = found[:3, :3].T @ turned
        rotation = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]) / 2
        shift = found[:3, :3].T @ (true[:3, 3] - found[:3, 3])
        errors.append((np.trace(D), np.concatenate([rotation, shift])))
    return max(errors, key=lambda e: e[0])[1]


def _found(cloud: _F64, size: tuple[float, float] = _SIZE) -> BoardInCloud:
    (board,) = find_boards([cloud], ["cloud"], size)
    assert isinstance(board, BoardInCloud), board
    return board


@pytest.mark.parametrize(
    ("beams", "range_m", "worst_mm", "worst_deg"),
    [((16, -15, 15), 2.5, 6, 0.4), ((32, -25, 15), 4.0, 6, 0.6), ((64, -25, 15), 8.0, 8, 0.8)],
)
def test_the_stated_spread_covers_the_error(
    beams: tuple[int, float, float], range_m: float, worst_mm: float, worst_deg: float
) -> None:
    rays = _beams(*beams)
    errors, normalised = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        true = _random_plate(range_m, rng)
        board = _found(_scan(rays, true, _SIZE, rng))
        errors.append(_error(board.T_lidar_plate, true))
        normalised.append(errors[-1] / np.sqrt(np.diag(board.covariance)))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.rad2deg(rms[:3]).max() < worst_deg
    assert rms[3:].max() * 1000 < worst_mm
    assert 0.7 < np.sqrt(np.mean(np.square(normalised))) < 1.5


def test_far_and_sparse_boards_are_found() -> None:
    rng = np.random.default_rng(0)
    for beams, range_m in (((16, -15, 15), 4.0), ((64, -25, 15), 12.0)):
        true = _random_plate(range_m, rng)
        board = _found(_scan(_beams(*beams), true, _SIZE, rng))
        error = _error(board.T_lidar_plate, true)
        assert np.abs(error[3:]).max() < 0.05  # two scan lines are 14 cm apart there
        assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(board.covariance)))


def test_a_board_that_stands_on_the_floor() -> None:
    rng = np.random.default_rng(1)
    size = (1.2, 0.8)
    true = _plate(np.array([4.0, 0.3, -1.6 + 0.4]), 0.3, 0.1)
    board = _found(_scan(_beams(32, -25, 15), true, size, rng), size)
    error = _error(board.T_lidar_plate, true)
    assert len(board.hidden_sides) == 1
    assert np.abs(error[3:]).max() < 0.015
    assert np.all(np.abs(error) < 4 * np.sqrt(np.diag(board.covariance)))


def test_a_board_that_a_person_holds() -> None:
    rng = np.random.default_rng(2)
    true = _plate(np.array([3.0, 0.2, -0.1]), 0.2, 0.1, 0.5)
    person = (np.array([3.15, 0.0, -1.6]), np.array([3.4, 0.5, 0.4]))
    cloud = _scan(_beams(32, -25, 15), true, _SIZE, rng, boxes=(person,))
    assert np.abs(_error(_found(cloud).T_lidar_plate, true)[3:]).max() < 0.01


def test_a_board_with_nothing_behind_it() -> None:
    rng = np.random.default_rng(3)
    true = _plate(np.array([4.0, -0.3, 0.6]), 0.0, 0.0, 0.4)
    cloud = _scan(_beams(32, -25, 15), true, _SIZE, rng, planes=[((0, 0, 1), -1.6)])
    assert np.abs(_error(_found(cloud).T_lidar_plate, true)[3:]).max() < 0.02


def test_a_square_board_up_to_quarter_turns() -> None:
    rng = np.random.default_rng(4)
    true = _random_plate(3.0, rng)
    board = _found(_scan(_beams(32, -25, 15), true, (0.8, 0.8), rng), (0.8, 0.8))
    error = _error(board.T_lidar_plate, true, turns=4)
    assert np.abs(error[3:]).max() < 0.01
    assert np.rad2deg(np.abs(error[:3]).max()) < 0.6


def test_edge_points_lie_on_the_true_rim() -> None:
    rng = np.random.default_rng(5)
    true = _random_plate(3.0, rng)
    board = _found(_scan(_beams(64, -25, 15), true, _SIZE, rng))
    at_plate = (board.edge_points - true[:3, 3]) @ true[:3, :3]
    off_rim = (np.abs(at_plate[:, :2]) - np.array(_SIZE) / 2).max(axis=1)
    assert len(board.edge_points) > 40
    assert set(board.edge_sides.tolist()) == {0, 1, 2, 3}
    assert np.sqrt(np.mean((off_rim / board.edge_sd_m) ** 2)) < 1.5
    inside = (board.edge_points - board.T_lidar_plate[:3, 3]) @ board.T_lidar_plate[:3, :3]
    sides = inside[:, :2] * [1, 1] / (np.array(_SIZE) / 2)
    for side, axis, sign in ((0, 0, -1), (1, 0, 1), (2, 1, -1), (3, 1, 1)):
        assert np.abs(sides[board.edge_sides == side, axis] - sign).max() < 0.2


@pytest.mark.parametrize("given", [(0.6, 0.4), (1.2, 0.8), (0.97, 0.7)])
def test_a_wrong_size_is_refused_and_the_right_one_said(given: tuple[float, float]) -> None:
    clouds = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        clouds.append(_scan(_beams(64, -25, 15), _random_plate(3.0, rng), _SIZE, rng))
    found = find_boards(clouds, list("abcde"), given)
    assert all(isinstance(one, NoBoardInCloud) for one in found)
    for one in found:
        assert isinstance(one, NoBoardInCloud)
        assert f"no plane of {given[0]:g} x {given[1]:g} m" in one.reason
        assert "is the plate's size right?" in one.reason
        said = one.reason.split("a rectangle of ")[1].split(" m")[0].split(" x ")
        assert np.allclose([float(side) for side in said], _SIZE, rtol=0.06)


def test_a_part_of_a_wall_is_no_board() -> None:
    rng = np.random.default_rng(6)
    far_away = _plate(np.array([100.0, 0.0, 0.0]), 0.0)
    (none,) = find_boards([_scan(_beams(32, -25, 15), far_away, _SIZE, rng)], ["room"], _SIZE)
    assert isinstance(none, NoBoardInCloud)
