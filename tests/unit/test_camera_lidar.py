"""Parts of the camera-LiDAR calibration: derivatives, seeds, geometry of poses, the verdict."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.camera_lidar.degeneracy import BoardSpread, board_spread, shortcomings
from percept.calib.camera_lidar.pairs import check_plate
from percept.calib.camera_lidar.problem import (
    COMMON,
    Common,
    PairData,
    Sigmas,
    linearise,
    moved_pose,
    pose_step,
    residuals_of,
)
from percept.calib.camera_lidar.refine import Priors, refine
from percept.calib.camera_lidar.result import CameraLidarCalibration, Estimate
from percept.calib.camera_lidar.seed import fit_rigid, rotation_angle_deg
from percept.calib.camera_lidar.spread import Split
from percept.calib.camera_lidar.verdict import Facts, judge
from percept.calib.limits import CameraLidarLimits
from percept.core.errors import UsageError
from percept.core.results import Verdict

_F64 = NDArray[np.float64]

_ONE = Sigmas(corner_px=1, point_m=1, plane_m=0, outline_m=1e-6, outline_rad=1e-6)


def _pair(seed: int = 0) -> tuple[PairData, Common, _F64]:
    """Return a pair with residuals of ordinary size, and where it is looked at."""
    rng = np.random.default_rng(seed)
    T_camera_plate = moved_pose(np.eye(4), np.array([0.3, -0.2, 0.1, 0.2, -0.1, 3.0]))
    T_camera_lidar = moved_pose(np.eye(4), rng.normal(0, 0.3, 6))
    T_lidar_plate = np.linalg.inv(T_camera_lidar) @ T_camera_plate
    corners = np.column_stack([rng.uniform(-0.3, 0.3, (12, 2)), np.zeros(12)])
    seen = corners @ T_camera_plate[:3, :3].T + T_camera_plate[:3, 3]
    cells = np.column_stack([rng.uniform(-0.4, 0.4, (9, 2)), rng.normal(0, 0.01, 9)])
    points = cells @ T_lidar_plate[:3, :3].T + T_lidar_plate[:3, 3]
    pair = PairData(
        name="pair",
        corners_plate=corners,
        seen_xy=seen[:, :2] / seen[:, 2:] + rng.normal(0, 1e-4, (12, 2)),
        pixels_per_xy=np.tile(1000 * np.eye(2), (12, 1, 1)),
        points_lidar=points,
        cells_lidar=points,
        cell_counts=np.ones(9),
        outline=moved_pose(T_lidar_plate, rng.normal(0, 0.003, 6)),
        outline_covariance=np.eye(3),
    )
    return pair, Common(T_camera_lidar, 0.01, 1.01, 0.99, (0.002, -0.001)), T_camera_plate


def _all_residuals(pair: PairData, common: Common, T: _F64) -> _F64:
    return np.concatenate(residuals_of(pair, common, T))


def test_the_normal_equations_are_those_of_numerical_derivatives() -> None:
    pair, common, T = _pair()
    step = 1e-6
    columns = [
        (
            _all_residuals(pair, common.moved(step * unit), T)
            - _all_residuals(pair, common.moved(-step * unit), T)
        )
        / (2 * step)
        for unit in np.eye(COMMON)
    ] + [
        (
            _all_residuals(pair, common, moved_pose(T, step * unit))
            - _all_residuals(pair, common, moved_pose(T, -step * unit))
        )
        / (2 * step)
        for unit in np.eye(6)
    ]
    J, r = np.array(columns).T, _all_residuals(pair, common, T)
    weight = 1 / (1 + (r / 3) ** 2)
    H, g = (J.T * weight) @ J, -(J.T * weight) @ r
    reduced = H[:COMMON, :COMMON] - H[:COMMON, COMMON:] @ np.linalg.solve(
        H[COMMON:, COMMON:], H[COMMON:, :COMMON]
    )
    right = g[:COMMON] - H[:COMMON, COMMON:] @ np.linalg.solve(H[COMMON:, COMMON:], g[COMMON:])
    block = linearise(pair, common, T, _ONE)
    np.testing.assert_allclose(block.common, reduced, rtol=5e-3, atol=5e-3)
    np.testing.assert_allclose(block.right, right, rtol=5e-3, atol=5e-3)


def test_a_pose_step_is_what_moves_one_pose_onto_another() -> None:
    rng = np.random.default_rng(1)
    T_a, T_b = (moved_pose(np.eye(4), rng.normal(0, 1, 6)) for _ in range(2))
    np.testing.assert_allclose(moved_pose(T_a, pose_step(T_a, T_b)), T_b, atol=1e-12)
    half_turn = moved_pose(np.eye(4), np.array([0, 0, np.pi, 0, 0, 0]))
    assert np.linalg.norm(pose_step(half_turn, half_turn)) == pytest.approx(0, abs=1e-12)


def test_refining_lowers_the_cost_and_ends_where_nothing_pulls() -> None:
    pair, common, T = _pair()
    start = Common(common.T_camera_lidar)
    solution = refine([pair], start, [T], Sigmas(1, 0.01, 0, 0.01, 0.01))
    first = linearise(pair, start, T, solution.sigmas).cost
    assert solution.cost < first
    prior = Priors().normal_equations(solution.common)[1]
    free = np.abs(sum(b.right for b in solution.blocks) + prior)[:7]
    assert free.max() < 1e-3 * np.sqrt(np.diag(solution.blocks[0].common)[:7]).max()


def test_a_rigid_fit_never_mirrors() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(0, 1, (6, 3))
    T = moved_pose(np.eye(4), rng.normal(0, 1, 6))
    np.testing.assert_allclose(fit_rigid(points, points @ T[:3, :3].T + T[:3, 3]), T, atol=1e-12)
    mirrored = fit_rigid(points, points * [-1, 1, 1])
    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1)


@pytest.mark.parametrize("degrees", [0.0, 1e-4, 90.0, 180.0])
def test_the_angle_between_rotations(degrees: float) -> None:
    R = moved_pose(np.eye(4), np.array([np.radians(degrees), 0, 0, 0, 0, 0]))[:3, :3]
    assert rotation_angle_deg(np.eye(3), R) == pytest.approx(degrees, abs=1e-6)


def test_the_spread_of_boards_is_told_by_axis() -> None:
    turns = np.radians([-30, 0, 30])
    poses = np.array([moved_pose(np.eye(4), np.array([0, a, 0, a, 0, 2])) for a in turns])
    spread = board_spread(poses)
    assert spread.turned_deg == pytest.approx(24.5, abs=0.1)
    assert spread.tilted_deg == pytest.approx(0, abs=1e-6)
    words = " ".join(reason for reason, _ in shortcomings(spread, CameraLidarLimits()))
    assert "never tilted up or down" in words
    assert "all face one way" not in words


@pytest.mark.parametrize(
    ("size_m", "match"),
    [
        ((0.61, 0.85), r"--board-size 0\.85x0\.61"),
        ((0.5, 0.5), "Check the square"),
        ((85.0, 61.0), "is no board"),
    ],
)
def test_a_plate_that_cannot_be_is_refused(size_m: tuple[float, float], match: str) -> None:
    row, column = np.divmod(np.arange(35), 7)
    corners = 0.095 * np.column_stack([column, row, np.zeros(35)])
    check_plate(corners, (0.85, 0.61))
    with pytest.raises(UsageError, match=match):
        check_plate(corners, size_m)


_GOOD = Facts(
    pairs=20,
    sighted=20,
    used=20,
    rival=0.0,
    mistake=None,
    sd_rotation_deg=np.full(3, 0.05),
    sd_translation_m=np.full(3, 0.003),
    splits={"every second pair": Split(np.zeros(6), np.zeros(6), 5.0)},
    spread=BoardSpread(4.0, 20.0, 20.0, 2.0, 4.0, 40.0, 20.0),
    board_scale=Estimate(1.0, 0.002),
    focal_scale=Estimate(1.0, 0.002),
    centre_off_deg=(Estimate(0.0, 0.05), Estimate(0.0, 0.05)),
    pattern_off_m=(Estimate(0.0, 0.001), Estimate(0.0, 0.001)),
    lens_fits_better=False,
    corner_rms_px=0.2,
    point_rms_m=0.015,
    plate_found=(Estimate(1.0, 0.01), Estimate(1.0, 0.01)),
)


@pytest.mark.parametrize(
    ("change", "verdict", "words"),
    [
        ({}, Verdict.GOOD, "20 pairs agree"),
        ({"used": 15}, Verdict.DOUBTFUL, "only 15 of 20 pairs with a board agree"),
        ({"used": 8}, Verdict.BAD, "only 8 of 20"),
        ({"pairs": 5, "sighted": 5, "used": 5}, Verdict.DOUBTFUL, "5 pairs are too few"),
        ({"pattern_off_m": (Estimate(0.02, 0.001),) * 2}, Verdict.DOUBTFUL, "20 mm off the plate"),
        ({"pattern_off_m": (Estimate(0.0, 0.02),) * 2}, Verdict.DOUBTFUL, "only known to 20 mm"),
        ({"moved_at": "7.0 s"}, Verdict.DOUBTFUL, "'7.0 s'"),
        ({"rival": 0.9}, Verdict.AMBIGUOUS, "another transform"),
        ({"mistake": ("the images look mirrored", "do")}, Verdict.BAD, "mirrored"),
        ({"sd_rotation_deg": np.array([0.3, 0, 0])}, Verdict.DOUBTFUL, "x (right)"),
        ({"sd_translation_m": np.array([0, 0, 0.2])}, Verdict.BAD, "z (forward)"),
        ({"sd_translation_m": np.full(3, np.nan)}, Verdict.BAD, "nan"),
        ({"board_scale": Estimate(1.02, 0.002)}, Verdict.DOUBTFUL, "1.020 times as large"),
        ({"board_scale": Estimate(1.1, 0.002)}, Verdict.BAD, "1.100 times as large"),
        ({"board_scale": Estimate(1.02, 0.02)}, Verdict.GOOD, "agree"),
        (
            {"lens_fits_better": True, "focal_scale": Estimate(0.95, 0.002)},
            Verdict.BAD,
            "focal length seems 0.950",
        ),
        ({"corner_rms_px": 2.0}, Verdict.DOUBTFUL, "2.0 px"),
        ({"point_rms_m": 0.1}, Verdict.BAD, "100 mm"),
        ({"plate_found": (Estimate(0.9, 0.01), Estimate(1, 0.01))}, Verdict.DOUBTFUL, "0.90 times"),
        ({"worse_than_initial": True}, Verdict.BAD, "fits the pairs better"),
        (
            {"splits": {"halves": Split(np.full(6, 0.01), np.full(6, 5.0), 5.0)}},
            Verdict.DOUBTFUL,
            "differ by",
        ),
    ],
)
def test_the_verdict(change: dict[str, object], verdict: Verdict, words: str) -> None:
    found, why, advice = judge(replace(_GOOD, **change))  # type: ignore[arg-type] # by name
    assert found is verdict
    assert words in " ".join(why)
    assert bool(advice) is (verdict is not Verdict.GOOD)


def test_nothing_found_is_valid_json_without_numbers() -> None:
    result = CameraLidarCalibration(verdict=Verdict.BAD, why=("none",), advice=(), pairs=())
    document = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert document["T_camera_lidar"] is None
    assert document["odd_even"] is None
    with pytest.raises(ValueError, match="no transform"):
        result.spread_at(10.0)


def test_the_spread_at_a_distance_grows_with_the_turn() -> None:
    covariance = np.diag([0.001**2, 0.001**2, 0.001**2, 0.003**2, 0.004**2, 0])
    result = CameraLidarCalibration(
        verdict=Verdict.GOOD, why=(), advice=(), pairs=(), covariance=covariance
    )
    assert result.spread_at(1e-9) == pytest.approx(0.005)
    assert result.spread_at(30.0) == pytest.approx(np.hypot(0.005, 0.03 * np.sqrt(2)))
