"""Boards in real VLP-16 clouds against what another tool extracted from its own recordings."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import BoardInCloud, NoBoardInCloud, find_boards
from percept.datasets.files.cloud_files import read_point_cloud

_F64 = NDArray[np.float64]
_SIZE = (0.85, 0.61)
_MOVED = 0  # pose 1: the board stands elsewhere in the stored cloud than in the other tool's frames


@pytest.fixture(scope="module")
def clouds(shared_data: Path) -> list[_F64]:
    folder = shared_data / "camera_lidar" / "acfr_vlp" / "clouds"
    return [
        read_point_cloud(folder / f"pose{k}.pcd").points_xyz.astype(np.float64)
        for k in range(1, 31)
    ]


@pytest.fixture(scope="module")
def features(shared_data: Path) -> _F64:
    """(30, 19, 3): camera centre, normal, corners, then the LiDAR's, in mm."""
    path = shared_data / "camera_lidar" / "acfr_vlp" / "features_poses_1_to_30.csv"
    return np.loadtxt(path, delimiter=",").reshape(30, 19, 3)


@pytest.fixture(scope="module")
def boards(clouds: list[_F64]) -> list[BoardInCloud]:
    found = find_boards(clouds, [f"pose{k}" for k in range(1, 31)], _SIZE)
    boards = [board for board in found if isinstance(board, BoardInCloud)]
    assert len(boards) == 30
    return boards


def _centres(boards: list[BoardInCloud]) -> _F64:
    return np.array([board.T_lidar_plate[:3, 3] for board in boards])


def test_every_board_is_where_the_other_tool_saw_it(
    boards: list[BoardInCloud], features: _F64
) -> None:
    apart = np.linalg.norm(_centres(boards) - features[:, 6] / 1000, axis=1)
    apart = np.delete(apart, _MOVED)
    assert np.median(apart) < 0.010
    assert apart.max() < 0.025
    assert {board.searched for board in boards} == {"what moves"}


def test_corners_agree(boards: list[BoardInCloud], features: _F64) -> None:
    half = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [*_SIZE, 0] / 2
    apart = []
    for board, theirs in zip(boards, features[:, 8:12] / 1000, strict=True):
        ours = half @ board.T_lidar_plate[:3, :3].T + board.T_lidar_plate[:3, 3]
        apart.append(
            min(
                np.linalg.norm(ours - theirs[list(order)], axis=1).max()
                for order in permutations(range(4))
            )
        )
    apart_m = np.delete(np.array(apart), _MOVED)
    assert np.median(apart_m) < 0.03
    assert apart_m.max() < 0.06


def test_centres_fit_the_camera_no_worse_than_the_other_tools(
    boards: list[BoardInCloud], features: _F64
) -> None:
    camera = np.delete(features[:, 0] / 1000, _MOVED, axis=0)

    def rms(lidar: _F64) -> float:
        a, b = lidar - lidar.mean(axis=0), camera - camera.mean(axis=0)
        U, _, Vt = np.linalg.svd(a.T @ b)
        R = Vt.T @ np.diag([1, 1, np.linalg.det(Vt.T @ U.T)]) @ U.T
        return float(np.sqrt(np.mean(np.sum((a @ R.T - b) ** 2, axis=1))))

    ours = rms(np.delete(_centres(boards), _MOVED, axis=0))
    theirs = rms(np.delete(features[:, 6] / 1000, _MOVED, axis=0))
    assert ours < 0.010
    assert ours < theirs


def _same(boards: list[object], expected: _F64, within_m: float) -> None:
    for board, centre in zip(boards, expected, strict=True):
        assert isinstance(board, BoardInCloud)
        assert np.linalg.norm(board.T_lidar_plate[:3, 3] - centre) < within_m


def test_a_single_cloud_is_enough(clouds: list[_F64], boards: list[BoardInCloud]) -> None:
    picked = list(range(0, 30, 3))
    single = [find_boards([clouds[k]], ["one"], _SIZE)[0] for k in picked]
    _same([*single], _centres(boards)[picked], 0.003)
    assert {board.searched for board in single if isinstance(board, BoardInCloud)} == {"everything"}


def test_neither_axes_nor_order_nor_gaps_matter(
    clouds: list[_F64], boards: list[BoardInCloud]
) -> None:
    rng = np.random.default_rng(0)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    picked = [1, 8, 14, 20, 25, 29]
    changed = []
    for k in picked:
        cloud = np.vstack([clouds[k] @ R.T, np.full((500, 3), np.nan), np.zeros((50, 3))])
        changed.append(cloud[rng.permutation(len(cloud))].astype(np.float32))
    found = find_boards(changed, [str(k) for k in picked], _SIZE)
    _same([*found], _centres(boards)[picked] @ R.T, 0.004)


def test_half_of_the_points_are_enough(clouds: list[_F64], boards: list[BoardInCloud]) -> None:
    found = find_boards([cloud[::2] for cloud in clouds], [str(k) for k in range(30)], _SIZE)
    _same([*found], _centres(boards), 0.012)


def test_a_board_that_stands_still_is_found_all_the_same(
    clouds: list[_F64], boards: list[BoardInCloud]
) -> None:
    found = find_boards([clouds[9]] * 5, list("abcde"), _SIZE)
    _same([*found], _centres(boards)[[9] * 5], 0.003)
    assert {board.searched for board in found if isinstance(board, BoardInCloud)} == {"everything"}


def test_no_cupboard_is_taken_for_a_board_of_a_wrong_size(clouds: list[_F64]) -> None:
    for wrong in ((0.75, 0.55), (1.0, 0.7)):
        for one in find_boards(clouds[:12], [str(k) for k in range(12)], wrong):
            assert isinstance(one, NoBoardInCloud)
            assert "is the plate's size right?" in one.reason
