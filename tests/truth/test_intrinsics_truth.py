"""Intrinsics of a known camera: right, as uncertain as they say, and never falsely good."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.views import BoardView
from percept.calib.intrinsics.calibrate import CameraCalibrationConfig, calibrate_camera
from percept.calib.intrinsics.lens import free_parameters
from percept.calib.intrinsics.result import CameraCalibration
from percept.calib.intrinsics.solver import solve
from percept.calib.intrinsics.start import start_estimate
from percept.calib.intrinsics.validation import fit_of, validate
from percept.calib.intrinsics.views import usable_views
from percept.core.cameras import Camera, make_camera
from percept.core.results import Verdict

_F64 = NDArray[np.float64]
_SIZE = (1280, 800)
_BOARD = Checkerboard(7, 5, 0.07)
_LENSES = {
    "pinhole": (900.0, [-0.28, 0.09, 0.0008, -0.0006, -0.01]),
    "rational": (620.0, [0.5, 0.2, 0.001, 0.002, 0.01, 0.9, 0.3, 0.02]),
    "fisheye": (480.0, [-0.03, 0.01, -0.004, 0.001]),
}


def _camera(model: str = "pinhole", focal: float | None = None) -> Camera:
    usual, distortion = _LENSES[model]
    focal = focal or usual
    K = np.array([[focal, 0, 652], [0, 1.003 * focal, 388], [0, 0, 1]])
    return make_camera(model, _SIZE, K, distortion)


def _views(
    camera: Camera,
    seed: int,
    *,
    count: int = 24,
    noise_px: float = 0.1,
    tilt_deg: tuple[float, float] = (0.0, 45.0),
    rows: tuple[float, float] = (0.0, 1.0),
    bend_m: float = 0.0,
    roll_rad: float = 0.2,
    stretch: float = 0.0,
    board: Checkerboard = _BOARD,
) -> list[BoardView]:
    """Boards all over a part of the image, a third to four fifths of its width."""
    rng = np.random.default_rng(seed)
    corners = board.corners_board() - board.corners_board().mean(axis=0)
    corners[:, 2] += bend_m * (1 - (corners[:, 0] / corners[:, 0].max()) ** 2)
    corners *= [1 + stretch, 1, 1]
    low, high = (share * _SIZE[1] for share in rows)
    views: list[BoardView] = []
    while len(views) < count:
        wide = rng.uniform(0.3, 0.8) * _SIZE[0]
        distance = board.columns * board.square_m * camera.K[0, 0] / wide
        tilt, way = np.radians(rng.uniform(*tilt_deg)), rng.uniform(0, 2 * np.pi)
        R = cv2.Rodrigues(np.array([np.cos(way) * tilt, np.sin(way) * tilt, 0]))[0]
        R = R @ cv2.Rodrigues(np.array([0, 0, rng.normal() * roll_rad]))[0]
        ray = camera.unproject(rng.uniform([0, low], [_SIZE[0], high], (1, 2)))[0]
        if not np.isfinite(ray).all():
            continue
        pixels, seen = camera.project(corners @ R.T + distance * ray)
        if seen.all() and low <= pixels[:, 1].min() and pixels[:, 1].max() <= high:
            found = pixels + rng.normal(size=pixels.shape) * noise_px
            views.append(BoardView(f"v{len(views):02d}", _SIZE, np.arange(len(found)), found))
    return views


def _parameters(camera: Camera) -> _F64:
    return np.array([camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]])


def _errors(result: CameraCalibration, truth: Camera) -> tuple[_F64, _F64]:
    """Return the errors of fx, fy, cx, cy, and their stated standard deviations."""
    assert result.fit is not None
    error = _parameters(result.fit.camera) - _parameters(truth)
    return error, np.array([result.fit.sd[name] for name in ("fx", "fy", "cx", "cy")])


@pytest.mark.parametrize("model", _LENSES)
def test_forty_spread_views_give_the_camera(model: str) -> None:
    truth = _camera(model)
    board = Checkerboard(10, 7, 0.05)
    result = calibrate_camera(_views(truth, 5, count=40, board=board), board)
    error, sd = _errors(result, truth)
    assert result.camera is not None
    assert result.camera.model == model
    assert (np.abs(error[:2]) < 0.0005 * truth.K[0, 0]).all()
    assert (np.abs(error[2:]) < 0.3).all()
    assert (np.abs(error) < 4 * sd).all()
    # Where no board was, in the outermost corners of a wide lens, models and halves may differ.
    assert result.verdict is (Verdict.GOOD if model == "pinhole" else result.verdict), result.why
    assert result.verdict.exit_code == 0


def _good_capture(camera: Camera, board: Checkerboard, seed: int) -> list[BoardView]:
    """Forty views as the advice wants them: large, all over the image, tilted and turned."""
    rng, tries = np.random.default_rng(seed), 1000
    corners = board.corners_board() - board.corners_board().mean(axis=0)
    way, tilt = rng.uniform(0, 2 * np.pi, tries), np.radians(rng.uniform(25, 45, tries))
    tilts = np.stack([np.cos(way), np.sin(way), np.zeros(tries)], axis=1) * tilt[:, None]
    rolls = rng.uniform(-np.pi / 2, np.pi / 2, tries)[:, None] * [0, 0, 1]
    R = (Rotation.from_rotvec(tilts) * Rotation.from_rotvec(rolls)).as_matrix()
    wide = rng.uniform(0.5, 0.8, tries) * _SIZE[0]
    distance = board.columns * board.square_m * camera.K[0, 0] / wide
    middles = camera.unproject(rng.uniform([0, 0], _SIZE, (tries, 2))) * distance[:, None]
    points = corners @ np.swapaxes(R, 1, 2) + middles[:, None]
    pixels, seen = camera.project(points.reshape(-1, 3))
    shown = pixels.reshape(tries, -1, 2)[seen.reshape(tries, -1).all(axis=1)][:40]
    shown = shown + rng.normal(size=shown.shape) * 0.1
    return [BoardView(f"v{k}", _SIZE, np.arange(len(v)), v) for k, v in enumerate(shown)]


@pytest.mark.parametrize("captures", [12, pytest.param(30, marks=pytest.mark.slow)])
def test_good_captures_are_within_half_a_thousandth_and_as_their_spread_says(captures: int) -> None:
    truth, board = _camera(), Checkerboard(12, 9, 0.04)
    free = free_parameters("pinhole", 3)
    errors, ratios = [], []
    for seed in range(captures):
        observations = usable_views(_good_capture(truth, board, seed), board).observations
        assert len(observations) == 40
        found = solve(observations, start_estimate("pinhole", observations, _SIZE), free)
        validation = validate(observations, fit_of(observations, found), _SIZE)
        sd = np.sqrt(np.diag(validation.covariance))
        errors.append(found.estimate.shared[:4] - _parameters(truth))
        ratios.append(errors[-1] / sd[:4])
    worst, rms = np.abs(errors).max(axis=0), np.sqrt(np.mean(np.square(errors), axis=0))
    assert (worst[:2] < 0.0005 * truth.K[0, 0]).all(), worst
    assert (worst[2:] < 0.3).all(), worst
    assert (rms[:2] < 0.0002 * truth.K[0, 0]).all(), rms
    assert (rms[2:] < 0.15).all(), rms
    normalised = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert (normalised > 0.7).all(), normalised
    assert (normalised < 1.5).all(), normalised


@pytest.mark.parametrize("roll_rad", [0.01, 0.2])
def test_a_stretched_print_is_named_whether_the_board_is_turned_or_not(roll_rad: float) -> None:
    views = _views(_camera(), 3, roll_rad=roll_rad, stretch=0.01)
    result = calibrate_camera(views, _BOARD)
    assert result.fit is not None
    assert result.verdict is Verdict.DOUBTFUL
    assert any("columns seem 1.0% longer than its rows" in why for why in result.why)
    assert any("measure the print" in advice for advice in result.advice)
    assert abs(result.fit.stretch.values[0] - 0.01) < 3 * result.fit.stretch.sd[0]


def test_a_bent_board_is_named_and_its_bend_found() -> None:
    truth = _camera()
    views = _views(truth, 2, count=40, bend_m=0.003)
    flat = calibrate_camera(views, _BOARD)
    assert flat.verdict is not Verdict.GOOD
    assert any("bent by" in why for why in flat.why)
    assert any("--board-warp" in advice for advice in flat.advice)
    bent = calibrate_camera(views, _BOARD, CameraCalibrationConfig(board_warp=True))
    assert bent.fit is not None
    assert bent.verdict is Verdict.GOOD, bent.why
    assert np.abs(bent.fit.bend.values - [0.003, 0.0]).max() < 1e-4
    error, _ = _errors(bent, truth)
    assert np.abs(error).max() < 0.7


@pytest.mark.parametrize("model", ["fisheye", "rational"])
def test_the_wrong_lens_model_is_bad_and_the_right_one_is_named(model: str) -> None:
    views = _views(_camera(model), 3, count=25)
    result = calibrate_camera(views, _BOARD, CameraCalibrationConfig(model="pinhole"))
    assert result.verdict is Verdict.BAD
    assert any(f"{model} model explains left-out views better" in why for why in result.why)


def test_boards_that_face_the_camera_leave_the_focal_length_open() -> None:
    truth = _camera()
    result = calibrate_camera(_views(truth, 1, tilt_deg=(0.0, 3.0)), _BOARD)
    assert result.verdict is Verdict.BAD
    assert "face the same way" in result.why[0]
    assert "tilted 30 to 45 deg" in result.advice[0]
    error, sd = _errors(result, truth)
    assert (np.abs(error) < 3 * sd).all()


def test_the_same_pose_again_and_again_is_bad() -> None:
    view = _views(_camera(), 0, count=1)[0]
    rng = np.random.default_rng(5)
    views = [
        replace(view, name=f"s{k}", corners_px=view.corners_px + 0.1 * rng.normal(size=(35, 2)))
        for k in range(15)
    ]
    assert calibrate_camera(views, _BOARD).verdict is Verdict.BAD


def test_no_board_low_in_the_image_is_bad_whatever_the_residuals() -> None:
    result = calibrate_camera(_views(_camera(), 2, rows=(0.0, 0.56)), _BOARD)
    assert result.fit is not None
    assert result.fit.rms_px < 0.2
    assert result.verdict is Verdict.BAD
    assert "bottom" in result.why[0]
    assert "low in the image" in result.advice[0]


def test_noise_instead_of_corners_is_bad() -> None:
    rng = np.random.default_rng(5)
    views = [
        BoardView(f"n{k}", _SIZE, np.arange(35), rng.uniform([0, 0], _SIZE, (35, 2)))
        for k in range(12)
    ]
    assert calibrate_camera(views, _BOARD).verdict is Verdict.BAD


def _mixed(strangers: int) -> list[BoardView]:
    views = _views(_camera(), 0, count=24)
    other = _views(_camera(focal=990.0), 9, count=24)[:strangers]
    return [*views[strangers:], *(replace(view, name=f"other{view.name}") for view in other)]


def test_a_few_views_of_another_camera_are_named_and_do_no_harm() -> None:
    result = calibrate_camera(_mixed(3), _BOARD)
    assert {view.name for view in result.views if not view.used} >= {"otherv00", "otherv01"}
    assert all("does not fit" in (v.reason or "") for v in result.views if not v.used)
    error, sd = _errors(result, _camera())
    assert (np.abs(error) < 4 * sd).all()
    assert result.verdict is not Verdict.BAD
    assert any("do not fit the others" in why for why in result.why)


def test_two_cameras_in_equal_parts_are_bad() -> None:
    assert calibrate_camera(_mixed(12), _BOARD).verdict is Verdict.BAD


def _shuffled(corners: _F64) -> _F64:
    # Two corners next to each other change places, four times: the turn of the board stays.
    order = np.arange(len(corners))
    order[[0, 1, 9, 10, 18, 19, 32, 33]] = order[[1, 0, 10, 9, 19, 18, 33, 32]]
    return corners[order]


@pytest.mark.parametrize(
    ("harm", "word"),
    [
        (_shuffled, "does not fit"),
        (lambda corners: corners * [-1, 1] + [_SIZE[0] - 1, 0], "mirrored"),
        (lambda corners: corners + 15 * np.sin(corners[:, ::-1] / 40), "does not fit"),
    ],
)
def test_one_spoilt_view_is_named_and_left_out(harm: object, word: str) -> None:
    assert callable(harm)
    truth = _camera()
    views = _views(truth, 4, count=25)
    views[7] = replace(views[7], corners_px=harm(views[7].corners_px))
    result = calibrate_camera(views, _BOARD)
    out = {view.name: view.reason or "" for view in result.views if not view.used}
    assert list(out) == ["v07"]
    assert word in out["v07"]
    error, sd = _errors(result, truth)
    assert (np.abs(error) < 4 * sd).all()


@pytest.mark.parametrize("count", [3, 5, 7])
def test_few_views_are_never_good(count: int) -> None:
    truth = _camera()
    result = calibrate_camera(_views(truth, 6, count=count), _BOARD)
    assert result.verdict is not Verdict.GOOD
    assert any(f"only {count} views" in why for why in result.why)


def _names(views: Sequence[BoardView]) -> list[str]:
    return [view.name for view in views]


def test_the_result_is_the_same_again() -> None:
    views = _views(_camera(), 8, count=7)
    first, second = calibrate_camera(views, _BOARD), calibrate_camera(views, _BOARD)
    assert first.as_dict() == second.as_dict()
    assert _names(views) == [view.name for view in first.views]
