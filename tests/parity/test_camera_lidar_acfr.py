"""The ACFR set: features that another tool extracted, against the transform found here."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import BoardInCloud, find_boards
from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.views import BoardView
from percept.calib.camera_lidar.calibrate import BoardPair, calibrate_camera_lidar
from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.calib.formats import read_intrinsics
from percept.core.cameras import Camera
from percept.core.results import Verdict
from percept.datasets import read_point_cloud

_F64 = NDArray[np.float64]

_POSES = range(1, 31)
_SIZE_M = (0.85, 0.61)
_HOW = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE


@pytest.fixture(scope="module")
def folder(shared_data: Path) -> Path:
    return shared_data / "camera_lidar" / "acfr_vlp"


@pytest.fixture(scope="module")
def camera(folder: Path) -> Camera:
    return read_intrinsics(folder / "camera_info.yaml").camera()


@pytest.fixture(scope="module")
def result(folder: Path, camera: Camera) -> CameraLidarCalibration:
    names = [f"pose{k}" for k in _POSES]
    clouds = [read_point_cloud(folder / "clouds" / f"{n}.pcd").points_xyz for n in names]
    boards = find_boards(clouds, names, _SIZE_M)
    assert all(isinstance(board, BoardInCloud) for board in boards), "found in every raw cloud"
    pairs = [
        BoardPair(name, _view(folder, name), board)
        for name, board in zip(names, boards, strict=True)
        if isinstance(board, BoardInCloud)
    ]
    return calibrate_camera_lidar(pairs, camera, Checkerboard(7, 5, 0.095), _SIZE_M)


def _view(folder: Path, name: str) -> BoardView:
    """Detect with OpenCV alone, at half size, so that only the calibration is tested."""
    grey = cv2.imread(str(folder / "images" / f"{name}.jpg"), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCorners(half, (7, 5), flags=_HOW)
    assert found
    corners = cv2.cornerSubPix(grey, 2 * corners + 0.5, (9, 9), (-1, -1), (3, 50, 1e-3))
    return BoardView(
        name, (grey.shape[1], grey.shape[0]), np.arange(35), corners.reshape(-1, 2).astype(float)
    )


def test_other_features_meet_within_4_px_and_8_mm(
    folder: Path, camera: Camera, result: CameraLidarCalibration
) -> None:
    lines = (folder / "features_poses_1_to_30.csv").read_text().split()
    rows = np.array([[float(v) for v in line.split(",")] for line in lines]).reshape(30, 19, 3)
    centre_camera, centre_lidar = rows[:, 0] / 1000, rows[:, 6] / 1000
    assert result.T_camera_lidar is not None
    assert result.range_offset_m is not None
    range_m = np.linalg.norm(centre_lidar, axis=1, keepdims=True)
    corrected = centre_lidar * (1 + result.range_offset_m.value / range_m)
    moved = corrected @ result.T_camera_lidar[:3, :3].T + result.T_camera_lidar[:3, 3]
    apart_mm = 1000 * np.linalg.norm(moved - centre_camera, axis=1)
    apart_px = np.linalg.norm(camera.project(moved)[0] - camera.project(centre_camera)[0], axis=1)
    assert apart_px.mean() < 4
    assert apart_mm.mean() < 8


def test_halves_agree_within_what_the_other_tool_reaches(result: CameraLidarCalibration) -> None:
    assert result.odd_even is not None
    assert result.odd_even.rotation_deg < 0.3
    assert result.odd_even.translation_m < 0.012
    assert result.verdict in (Verdict.GOOD, Verdict.DOUBTFUL)
    assert sum(pair.used for pair in result.pairs) >= 28
