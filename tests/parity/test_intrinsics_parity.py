"""Intrinsics of real images, against the answers of other tools."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.detection import detect_boards
from percept.calib.boards.selection import select_views
from percept.calib.boards.views import BoardView
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig, calibrate_camera
from percept.calib.intrinsics.result import CameraCalibration
from percept.core.results import Verdict


def _grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return np.asarray(image)


def _calibrated(paths: list[Path], board: Checkerboard) -> CameraCalibration:
    views, missing = detect_boards(((p.name, partial(_grey, p)) for p in paths), board)
    kept, dropped = select_views(views)
    return calibrate_camera(kept, board, rejected=[*missing, *dropped])


def test_corner_lists_give_the_answer_of_the_matlab_toolbox(shared_data: Path) -> None:
    folder = shared_data / "intrinsics" / "opencv_extra_calib1"
    lines = np.loadtxt(folder / "image_points.txt").reshape(7, 35, 2)
    views = [BoardView(f"{k}", (640, 480), np.arange(35), p) for k, p in enumerate(lines)]
    config = CameraCalibrationConfig(model="pinhole", radial_coefficients=2)
    result = calibrate_camera(views, Checkerboard(7, 5, 2.54), config)
    assert result.fit is not None
    K, distortion = result.fit.camera.K, result.fit.camera.distortion
    # The toolbox stops 1.1 and 1.5 thousandths of a pixel before the minimum in fx and fy.
    np.testing.assert_allclose([K[0, 0], K[1, 1]], [809.94790, 806.55964], atol=2e-3)
    np.testing.assert_allclose([K[0, 2], K[1, 2]], [361.99611, 214.39514], atol=1e-3)
    np.testing.assert_allclose(distortion[:2], [-0.12821, -0.39441], atol=1e-4)
    np.testing.assert_allclose(distortion[2:], [-0.00435, -0.00732, 0], atol=1e-5)
    assert result.fit.noise_px == pytest.approx(0.1, abs=0.01)
    assert "k3" not in result.fit.sd
    assert result.verdict is not Verdict.GOOD


def test_plain_corners_of_the_opencv_samples_name_the_bad_view(shared_data: Path) -> None:
    board = Checkerboard(9, 6, 0.025)
    views = []
    for path in sorted((shared_data / "intrinsics" / "opencv_samples").glob("left*.jpg")):
        image = _grey(path)
        _, found = cv2.findChessboardCorners(image, (9, 6))
        stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.01)
        corners = cv2.cornerSubPix(image, found, (11, 11), (-1, -1), stop).reshape(-1, 2)
        views.append(BoardView(path.name, (640, 480), np.arange(54), corners.astype(float)))
    result = calibrate_camera(views, board)
    assert result.fit is not None
    left_out = {view.name: view.reason or "" for view in result.views if not view.used}
    assert "does not fit" in left_out["left02.jpg"]
    stored = cv2.FileStorage(
        str(shared_data / "intrinsics" / "opencv_samples" / "left_intrinsics.yml"),
        cv2.FILE_STORAGE_READ,
    )
    theirs = stored.getNode("avg_reprojection_error").real()
    K = stored.getNode("camera_matrix").mat()
    assert result.fit.rms_px < theirs
    np.testing.assert_allclose(result.fit.camera.K, K, atol=4)


def test_the_same_minimum_as_opencv(shared_data: Path) -> None:
    board = Checkerboard(15, 17, 0.05)
    folder = shared_data / "intrinsics" / "opencalib_board15x17"
    views, missing = detect_boards(
        ((p.name, partial(_grey, p)) for p in sorted(folder.glob("*.jpg"))), board
    )
    assert len(views) == 15
    assert not missing
    result = calibrate_camera(views, board, CameraCalibrationConfig(model="pinhole"))
    assert result.fit is not None
    assert not result.fit.corners_left_out
    assert all(view.used for view in result.views)
    points = [board.corners_board()[view.ids].astype(np.float32) for view in views]
    pixels = [view.corners_px.astype(np.float32) for view in views]
    rms, K, distortion, _, _ = cv2.calibrateCamera(
        points, pixels, views[0].image_size, np.eye(3), np.zeros(5)
    )
    assert result.fit.rms_px <= rms * (1 + 1e-6)
    np.testing.assert_allclose(result.fit.camera.K, K, atol=0.02)
    np.testing.assert_allclose(result.fit.camera.distortion, distortion.ravel(), atol=1e-4)
    halves = [
        calibrate_camera(half, board, CameraCalibrationConfig(model="pinhole")).camera
        for half in (views[::2], views[1::2])
    ]
    assert halves[0] is not None
    assert halves[1] is not None
    ratio = np.diag(halves[0].K)[:2] / np.diag(halves[1].K)[:2]
    assert np.abs(ratio - 1).max() < 0.001


def test_views_without_a_board_and_of_another_size_are_named(shared_data: Path) -> None:
    folder = shared_data / "intrinsics" / "carnd_camera_cal"
    result = _calibrated(sorted(folder.glob("*.jpg")), Checkerboard(9, 6, 0.025))
    left_out = {v.name.removesuffix(".jpg"): v.reason or "" for v in result.views if not v.used}
    assert set(left_out) == {f"calibration{k}" for k in (1, 15, 5, 7)}
    assert result.camera is not None
    # The bent board pulls fisheye polynomials to coefficients of 40; the simple lens is as good.
    assert result.camera.model == "pinhole"
    assert np.abs(result.camera.distortion).max() < 1
    assert all("1281x721" in left_out[f"calibration{k}"] for k in (7, 15))
    assert result.verdict is not Verdict.GOOD  # halves of these views give different cameras


def test_small_residuals_do_not_hide_that_the_lower_half_was_never_seen(shared_data: Path) -> None:
    folder = shared_data / "camera_lidar" / "acfr_vlp" / "images"
    result = _calibrated(sorted(folder.glob("*.jpg")), Checkerboard(7, 5, 0.095))
    assert result.fit is not None
    assert sum(view.used for view in result.views) >= 28
    assert result.fit.rms_px < 0.2
    assert result.verdict is Verdict.BAD
    assert "bottom 44% of the image" in result.why[0]
    assert result.advice[0] == "add 4 views low in the image, tilted 30 to 45 deg"
