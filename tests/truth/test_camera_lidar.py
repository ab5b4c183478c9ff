"""Camera-LiDAR calibration against a known truth, and what it says of data that cannot be right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import BoardInCloud
from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.views import BoardView
from percept.calib.camera_lidar.calibrate import (
    BoardPair,
    CameraLidarCalibrationConfig,
    calibrate_camera_lidar,
)
from percept.calib.camera_lidar.problem import moved_pose, pose_step
from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.core.cameras import Camera, make_camera
from percept.core.errors import UsageError
from percept.core.results import Verdict

_F64 = NDArray[np.float64]

_BOARD = Checkerboard(7, 5, 0.1)
_PLATE_M = (0.9, 0.7)
_FLIP = np.diag([1.0, -1.0, -1.0])


def _camera(focal: float = 1.0, down_px: float = 0.0) -> Camera:
    K = np.array([[1200 * focal, 0, 960], [0, 1200 * focal, 600 + down_px], [0, 0, 1]])
    return make_camera("pinhole", (1920, 1200), K, [-0.1, 0.02])


_PINHOLE = _camera()
_FISHEYE = make_camera(
    "fisheye", (1920, 1208), [[1177, 0, 962], [0, 1178, 612], [0, 0, 1]], [-0.05, -0.08, 0.1, -0.05]
)


@dataclass(frozen=True, kw_only=True)
class _World:
    """How boards stand and how well they are seen."""

    camera: Camera = _PINHOLE
    tilt_deg: float = 30.0
    distance_m: tuple[float, float] = (1.8, 4.5)
    width: float = 1.0
    corner_px: float = 0.1
    range_m: float = 0.01
    outline_m: float = 0.0015
    outline_rad: float = 0.003
    points: int = 600
    plate_m: tuple[float, float] = _PLATE_M
    range_offset_m: float = 0.0
    pattern_m: tuple[float, float] = (0.0, 0.0)

    def pose(self, rng: np.random.Generator) -> _F64:
        """Return T_camera_plate of a board that the camera sees whole."""
        corners = _BOARD.corners_board()
        while True:
            ray = np.array([*(self.width * rng.uniform(-1, 1, 2) * [0.7, 0.45]), 1.0])
            ray /= np.linalg.norm(ray)
            tilt = np.radians(rng.uniform(-self.tilt_deg, self.tilt_deg, 2))
            turn = np.array([*tilt, rng.uniform(-0.8, 0.8), 0, 0, 0])
            T = moved_pose(np.eye(4), turn)
            T[:3, 3] = ray * rng.uniform(*self.distance_m)
            seen = self.camera.project((corners - corners.mean(axis=0)) @ T[:3, :3].T + T[:3, 3])[1]
            if seen.all() and T[:3, 2] @ ray > 0.5:
                return T

    def pair(
        self, rng: np.random.Generator, T_camera_lidar: _F64, T_camera_plate: _F64, name: str
    ) -> BoardPair:
        T_lidar_plate = np.linalg.inv(T_camera_lidar) @ T_camera_plate
        T_lidar_plate[:3, 3] -= T_lidar_plate[:3, :2] @ self.pattern_m
        return BoardPair(
            name, self._view(rng, T_camera_plate, name), self._board(rng, T_lidar_plate, name)
        )

    def _view(self, rng: np.random.Generator, T: _F64, name: str) -> BoardView:
        corners = _BOARD.corners_board()
        corners = corners - corners.mean(axis=0)
        pixels, _ = self.camera.project(corners @ T[:3, :3].T + T[:3, 3])
        noise = rng.normal(0, self.corner_px, pixels.shape)
        return BoardView(name, self.camera.image_size, np.arange(len(pixels)), pixels + noise)

    def _board(self, rng: np.random.Generator, T: _F64, name: str) -> BoardInCloud:
        flat = rng.uniform(-0.5, 0.5, (self.points, 2)) * self.plate_m
        points = np.column_stack([flat, np.zeros(self.points)]) @ T[:3, :3].T + T[:3, 3]
        range_m = np.linalg.norm(points, axis=1, keepdims=True)
        points *= 1 + (rng.normal(0, self.range_m, range_m.shape) - self.range_offset_m) / range_m
        place_sd = [self.outline_m, self.outline_m, self.outline_rad]
        covariance = np.diag([1e-5, 1e-5, *np.square(place_sd)[[2, 0, 1]], 1e-6])
        return BoardInCloud(
            name=name,
            points=points,
            T_lidar_plate=_seen_plate(T, points, rng.normal(0, place_sd), int(rng.integers(2))),
            size_found_m=self.plate_m,
            rms_m=self.range_m,
            score=1.0,
            explained=1.0,
            covariance=covariance,
            edge_points=np.empty((0, 3)),
            edge_sides=np.empty(0, np.int64),
            edge_sd_m=np.empty(0),
            bloom_m=0.0,
            hidden_sides=(),
            searched="everything",
        )


def _seen_plate(T: _F64, points: _F64, place_error: _F64, half_turns: int) -> _F64:
    """Return the plate on the plane of its points, misplaced in it, z towards the sensor."""
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle)[2][2]
    normal = normal if normal @ T[:3, 2] > 0 else -normal
    x = T[:3, 0] - normal * (normal @ T[:3, 0])
    x /= np.linalg.norm(x)
    found = np.eye(4)
    found[:3, :3] = np.column_stack([x, np.cross(normal, x), normal])
    found[:3, 3] = T[:3, 3] * (middle @ normal) / (T[:3, 3] @ normal)
    found[:3, 3] += found[:3, :2] @ place_error[:2]
    spin = moved_pose(np.eye(4), np.array([0, 0, place_error[2] + np.pi * half_turns, 0, 0, 0]))
    found[:3, :3] = found[:3, :3] @ spin[:3, :3] @ _FLIP
    return found


def _mounting(rng: np.random.Generator) -> _F64:
    """Return T_camera_lidar of a LiDAR near a camera that looks along the LiDAR's x."""
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    return moved_pose(T, np.concatenate([rng.normal(0, 0.15, 3), rng.normal(0, 0.2, 3)]))


def _capture(seed: int, count: int, world: _World | None = None) -> tuple[_F64, list[BoardPair]]:
    world = world or _World()
    rng = np.random.default_rng(seed)
    T = _mounting(rng)
    return T, [world.pair(rng, T, world.pose(rng), f"pose{k}") for k in range(count)]


def _calibrate(pairs: Sequence[BoardPair], camera: Camera = _PINHOLE) -> CameraLidarCalibration:
    return calibrate_camera_lidar(pairs, camera, _BOARD, _PLATE_M)


def _error(result: CameraLidarCalibration, T_camera_lidar: _F64) -> tuple[float, float]:
    """Return the errors in degrees and millimetres."""
    assert result.T_camera_lidar is not None
    step = pose_step(result.T_camera_lidar, T_camera_lidar)
    return float(np.degrees(np.linalg.norm(step[:3]))), float(1000 * np.linalg.norm(step[3:]))


# ---- truth comes back


@pytest.mark.parametrize(
    ("camera", "seeds"), [(_PINHOLE, (100, 101)), (_FISHEYE, (102,))], ids=["pinhole", "fisheye"]
)
def test_the_truth_comes_back_with_35_poses(camera: Camera, seeds: tuple[int, ...]) -> None:
    errors = []
    for seed in seeds:
        T, pairs = _capture(seed, 35, _World(camera=camera, points=1000))
        result = _calibrate(pairs, camera)
        assert result.verdict is Verdict.GOOD, result.why
        errors.append(_error(result, T))
    assert np.mean([e[0] for e in errors]) < 0.02
    assert max(e[1] for e in errors) < 2.0


def test_without_noise_the_answer_is_exact() -> None:
    world = _World(corner_px=0, range_m=0, outline_m=1e-9, outline_rad=1e-9)
    T, pairs = _capture(3, 8, world)
    assert _error(_calibrate(pairs), T) == pytest.approx((0, 0), abs=1e-3)


@pytest.mark.parametrize("seeds", [15, pytest.param(30, marks=pytest.mark.slow)])
def test_the_stated_spread_covers_the_error_over_many_seeds(seeds: int) -> None:
    """With intrinsics and patterns that are as wrong as the settings say they may be."""
    config = CameraLidarCalibrationConfig()
    normalised = []
    for seed in range(seeds):
        rng = np.random.default_rng(1000 + seed)
        pattern = rng.normal(0, config.pattern_sd_m, 2)
        T, pairs = _capture(seed, 7, _World(pattern_m=(pattern[0], pattern[1])))
        focal = 1 + rng.normal(0, config.focal_scale_sd)
        off_px = 1200 * np.tan(np.radians(rng.normal(0, config.centre_sd_deg)))
        result = _calibrate(pairs, _camera(focal, off_px))
        assert result.T_camera_lidar is not None
        assert result.covariance is not None
        step = pose_step(result.T_camera_lidar, T)
        normalised.append(step / np.sqrt(np.diag(result.covariance)))
    assert 0.7 < float(np.sqrt(np.mean(np.square(normalised)))) < 1.5
    by_axis = np.sqrt(np.mean(np.square(normalised), axis=0))
    assert by_axis.min() > 0.45
    assert by_axis.max() < 1.5


@pytest.mark.parametrize("pattern_m", [(0.02, 0.0), (0.0, -0.015)])
def test_a_pattern_beside_the_middle_of_the_plate_is_not_good(
    pattern_m: tuple[float, float],
) -> None:
    _, pairs = _capture(5, 12, _World(pattern_m=pattern_m))
    result = _calibrate(pairs)
    assert result.verdict is Verdict.DOUBTFUL
    assert "off the plate's middle" in " ".join(result.why)
    assert result.pattern_off_m is not None
    found = [estimate.value for estimate in result.pattern_off_m]
    assert found == pytest.approx(pattern_m, abs=0.003)


def test_a_sensor_that_moved_before_the_last_pairs_is_not_good() -> None:
    world, rng = _World(), np.random.default_rng(5)
    T = _mounting(rng)
    moved = moved_pose(T, np.array([np.radians(1), 0, 0, 0, -0.05, 0]))
    pairs = [world.pair(rng, T if k < 10 else moved, world.pose(rng), f"{k}") for k in range(12)]
    result = _calibrate(pairs)
    assert result.verdict is Verdict.DOUBTFUL
    assert "'10'" in " ".join(result.why)


@pytest.mark.parametrize("focal", [0.98, 0.99, 1.01])
def test_a_slightly_wrong_focal_length_is_named_or_in_the_spread(focal: float) -> None:
    T, pairs = _capture(6, 16)
    result = _calibrate(pairs, _camera(focal))
    assert result.T_camera_lidar is not None
    assert result.sd_translation_m is not None
    off_m = np.abs(pose_step(result.T_camera_lidar, T)[3:])
    assert (off_m < 3 * result.sd_translation_m).all()
    assert focal > 0.98 or result.verdict is not Verdict.GOOD


def test_a_range_offset_is_what_is_to_be_added() -> None:
    T, pairs = _capture(4, 20, _World(range_offset_m=0.02))
    result = _calibrate(pairs)
    assert result.range_offset_m is not None
    assert result.range_offset_m.value == pytest.approx(0.02, abs=0.003)
    assert _error(result, T)[1] < 8


def test_a_square_plate_is_turned_by_quarters() -> None:
    world = _World(plate_m=(0.9, 0.9))
    T, pairs = _capture(7, 10, world)
    for k, pair in enumerate(pairs):
        assert pair.board is not None
        quarter = moved_pose(np.eye(4), np.array([0, 0, k * np.pi / 2, 0, 0, 0]))
        turned = replace(pair.board, T_lidar_plate=pair.board.T_lidar_plate @ quarter)
        pairs[k] = replace(pair, board=turned)
    result = calibrate_camera_lidar(pairs, _PINHOLE, _BOARD, (0.9, 0.9))
    assert _error(result, T)[0] < 0.1
    assert result.verdict is Verdict.GOOD


def test_another_plate_in_the_cloud_is_not_taken() -> None:
    T, pairs = _capture(8, 10)
    rng = np.random.default_rng(0)
    for k in range(0, 10, 2):
        board = pairs[k].board
        assert board is not None
        other = replace(board, T_lidar_plate=moved_pose(board.T_lidar_plate, rng.normal(0, 1, 6)))
        pairs[k] = replace(pairs[k], board=replace(other, alternatives=(board,)))
    result = _calibrate(pairs)
    assert _error(result, T)[0] < 0.1
    assert all(pair.used for pair in result.pairs)


# ---- nothing wrong is called good


def _clouds_as(pairs: Sequence[BoardPair], order: Sequence[int]) -> list[BoardPair]:
    return [replace(p, board=pairs[order[k]].board) for k, p in enumerate(pairs)]


def test_swapped_files_are_named() -> None:
    T, pairs = _capture(1, 12)
    order = [0, 1, 7, 3, 4, 5, 6, 2, 8, 9, 10, 11]
    result = _calibrate(_clouds_as(pairs, order))
    left_out = {p.name: str(p.reason) for p in result.pairs if not p.used}
    assert set(left_out) == {"pose2", "pose7"}
    assert "'pose7'" in left_out["pose2"]
    assert "'pose2'" in left_out["pose7"]
    assert _error(result, T)[0] < 0.15


@pytest.mark.parametrize(
    ("order", "words"),
    [(np.roll(np.arange(12), 1), "later"), (np.random.default_rng(0).permutation(12), "only")],
    ids=["shifted", "shuffled"],
)
def test_files_that_do_not_belong_together_are_bad(order: Sequence[int], words: str) -> None:
    _, pairs = _capture(1, 12)
    result = _calibrate(_clouds_as(pairs, order))
    assert result.verdict is Verdict.BAD
    assert words in " ".join(result.why)


def test_mirrored_images_are_bad_and_named() -> None:
    _, pairs = _capture(1, 12)
    mirrored = [
        replace(p, view=replace(p.view, corners_px=p.view.corners_px * [-1, 1] + [1919, 0]))
        for p in pairs
        if p.view is not None
    ]
    result = _calibrate(mirrored)
    assert result.verdict is Verdict.BAD
    assert "mirrored" in result.why[0]


@pytest.mark.parametrize("square_m", [0.09, 0.11])
def test_a_wrong_square_is_bad_and_its_size_is_said(square_m: float) -> None:
    _, pairs = _capture(1, 16)
    result = calibrate_camera_lidar(pairs, _PINHOLE, Checkerboard(7, 5, square_m), _PLATE_M)
    assert result.verdict is Verdict.BAD
    assert "times as large as given" in " ".join(result.why)


def test_a_square_that_is_3_percent_off_is_not_good() -> None:
    _, pairs = _capture(1, 16)
    result = calibrate_camera_lidar(pairs, _PINHOLE, Checkerboard(7, 5, 0.103), _PLATE_M)
    assert result.verdict in (Verdict.DOUBTFUL, Verdict.BAD)
    assert "times as large as given" in " ".join(result.why)
    assert result.board_scale is not None
    assert result.board_scale.value == pytest.approx(1 / 1.03, abs=0.01)


@pytest.mark.parametrize("focal", [0.95, 1.05])
def test_a_wrong_focal_length_is_not_good_and_is_named(focal: float) -> None:
    _, pairs = _capture(1, 16)
    result = _calibrate(pairs, _camera(focal))
    assert result.verdict in (Verdict.DOUBTFUL, Verdict.BAD)
    assert "focal length" in " ".join(result.why)


def test_a_wrong_principal_point_is_not_good() -> None:
    _, pairs = _capture(1, 16)
    result = _calibrate(pairs, _camera(down_px=40))
    assert result.verdict in (Verdict.DOUBTFUL, Verdict.BAD)
    assert "principal point" in " ".join(result.why)


@pytest.mark.parametrize(
    ("world", "words"),
    [
        (_World(tilt_deg=1), "all face one way"),
        (_World(distance_m=(3.0, 3.05)), "at one distance"),
        (_World(width=0.05), "in one direction"),
    ],
    ids=["one way", "one distance", "one direction"],
)
def test_poses_that_are_too_alike_are_named(world: _World, words: str) -> None:
    _, pairs = _capture(2, 12, world)
    result = _calibrate(pairs)
    assert result.verdict is Verdict.DOUBTFUL
    assert words in " ".join(result.why)
    assert any("Add poses" in advice for advice in result.advice)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_few_pairs_are_never_good(count: int) -> None:
    _, pairs = _capture(1, count)
    verdict = _calibrate(pairs).verdict
    assert verdict is (Verdict.AMBIGUOUS, Verdict.BAD, Verdict.DOUBTFUL)[count // 2]


def test_one_pose_many_times_is_ambiguous() -> None:
    world, rng = _World(), np.random.default_rng(3)
    T, pose = _mounting(rng), world.pose(rng)
    pairs = [world.pair(rng, T, pose, f"{k}") for k in range(8)]
    assert _calibrate(pairs).verdict is Verdict.AMBIGUOUS


@pytest.mark.parametrize(
    ("degrees", "metres"), [(0.6, 0.02), (2.0, 0.05), (10.0, 0.3)], ids=["a bit", "some", "far"]
)
def test_a_sensor_that_moved_is_not_good(degrees: float, metres: float) -> None:
    world, rng = _World(), np.random.default_rng(5)
    T = _mounting(rng)
    moved = moved_pose(T, np.array([np.radians(degrees), 0, 0, 0, metres, 0]))
    pairs = [world.pair(rng, T if k < 8 else moved, world.pose(rng), f"{k}") for k in range(16)]
    result = _calibrate(pairs)
    assert result.verdict in (Verdict.DOUBTFUL, Verdict.BAD)
    if degrees > 5:
        assert "a sensor moved" in " ".join(result.why)


def test_no_board_at_all_is_bad_and_says_so() -> None:
    result = _calibrate([BoardPair("a", None, None, ("image: too dark",))])
    assert result.verdict is Verdict.BAD
    assert result.T_camera_lidar is None
    assert result.as_json()["pairs"][0]["reason"] == "image: too dark"


def test_a_plate_that_the_pattern_does_not_fit_on_is_refused() -> None:
    _, pairs = _capture(1, 3)
    with pytest.raises(UsageError, match=r"Write --board-size 0\.9x0\.7"):
        calibrate_camera_lidar(pairs, _PINHOLE, _BOARD, (0.7, 0.9))


def test_a_wrong_start_changes_nothing() -> None:
    T, pairs = _capture(1, 12)
    wrong = moved_pose(T, np.array([0.0, 0, 0, 0.1, 0, 0]))
    assert (
        calibrate_camera_lidar(pairs, _PINHOLE, _BOARD, _PLATE_M, initial=wrong).verdict
        is Verdict.GOOD
    )
