"""Checks of real rigs: what is there holds, and a place that was changed is found."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.board_in_cloud.find import BoardInCloud, find_boards
from percept.calib.boards.definitions import load_board
from percept.calib.boards.detection import detect_board
from percept.calib.boards.views import BoardView
from percept.calib.camera_lidar.calibrate import BoardPair, calibrate_camera_lidar
from percept.calib.check.check import CameraBoards, check_calibration
from percept.calib.check.result import AXES
from percept.calib.formats import read_intrinsics
from percept.calib.lidars.registration import apply_step
from percept.core.results import Verdict
from percept.core.transform import rotation_from_rpy
from percept.datasets import read_point_cloud
from percept.datasets.decoding.images import pixels_of_file_bytes

Matrix = NDArray[np.float64]

_SLOW = pytest.mark.slow
_PLATE_M = (0.85, 0.61)


def _cloud(path: Path) -> NDArray[np.float32]:
    return read_point_cloud(path).points_xyz


def _step(axis: str, metres: float, degrees: float) -> Matrix:
    step = np.zeros(6)
    index = AXES.index(axis)
    step[(index + 3) % 6] = metres if index < 3 else np.radians(degrees)
    return step


def _rig_of_reference(folder: Path) -> dict[str, Matrix]:
    """Return the mean over the scenes of another tool's answers, the top LiDAR as the base."""
    reference = json.loads((folder / "reference_gicp.json").read_text())
    rig = {"top": np.eye(4)}
    for name in ("left", "right"):
        roll, pitch, yaw, *at = np.mean(list(reference[name].values()), axis=0)
        rig[name] = np.eye(4)
        rig[name][:3, :3] = rotation_from_rpy(*np.radians([roll, pitch, yaw]))
        rig[name][:3, 3] = at
    return rig


@pytest.fixture(scope="module")
def car(shared_data: Path) -> tuple[dict[str, Matrix], list[dict[str, Any]]]:
    """A rig of three LiDARs by another tool, and two scenes of it."""
    folder = shared_data / "lidar2lidar" / "opencalib_rig"
    names = ("top", "left", "right")
    scenes = [
        {name: _cloud(next((folder / scene).glob(f"{name}*.pcd"))) for name in names}
        for scene in ("0001", "0002")
    ]
    return _rig_of_reference(folder), scenes


def test_a_rig_that_another_tool_made_holds(car: Any) -> None:
    rig, scenes = car
    result = check_calibration(rig, scenes=scenes)
    assert result.verdict.exit_code == 0
    assert not [p for p in result.pairs if p.moved]
    assert all(len(p.judged) == 6 for p in result.pairs if "top" in (p.against, p.sensor))


# One sensor that moved is found and named in made scenes, in tests/truth, at every run.
@_SLOW
@pytest.mark.parametrize("axis", AXES)
def test_a_shifted_lidar_is_found_and_named(car: Any, axis: str) -> None:
    rig, scenes = car
    shifted = {**rig, "left": apply_step(rig["left"], _step(axis, 0.05, 1.0))}
    result = check_calibration(shifted, scenes=scenes)
    assert result.verdict is Verdict.BAD
    assert [moved.sensor for moved in result.moved] == ["left"]


@_SLOW
@pytest.mark.parametrize("axis", ["x", "yaw"])
def test_a_small_shift_does_not_blame_a_sensor(car: Any, axis: str) -> None:
    rig, scenes = car
    shifted = {**rig, "left": apply_step(rig["left"], _step(axis, 0.01, 0.1))}
    result = check_calibration(shifted, scenes=scenes)
    assert result.verdict.exit_code == 0
    assert not result.moved


@_SLOW
def test_a_factory_rig_is_not_cried_wolf_over_by_one_sweep(shared_data: Path) -> None:
    folder = shared_data / "lidar2lidar" / "av2_rig_7fab2350"
    truth = json.loads((folder / "ground_truth.json").read_text())
    rig = {n: np.array(truth[f"egovehicle_SE3_{n}_lidar"]) for n in ("up", "down")}
    scene = {name: _cloud(folder / "sweep0" / f"{name}.pcd") for name in rig}
    result = check_calibration(rig, scenes=[scene])
    assert result.verdict is Verdict.DOUBTFUL
    assert "one scene" in " ".join(result.why)


@pytest.fixture(scope="module")
def poses(shared_data: Path) -> tuple[Any, Any, list[BoardPair]]:
    """Camera, board and all pairs of the ACFR capture."""
    folder = shared_data / "camera_lidar" / "acfr_vlp"
    camera = read_intrinsics(folder / "camera_info.yaml", None).camera()
    board = load_board("checkerboard:7x5:0.095").board
    names = [f"pose{number}" for number in range(1, 31)]
    clouds = [_cloud(folder / "clouds" / f"{name}.pcd") for name in names]
    pairs = []
    for name, found in zip(names, find_boards(clouds, names, _PLATE_M), strict=True):
        image = folder / "images" / f"{name}.jpg"
        pixels, _ = pixels_of_file_bytes(image.read_bytes(), str(image))
        view = detect_board(pixels, board, name=name)
        pairs.append(
            BoardPair(
                name,
                view if isinstance(view, BoardView) else None,
                found if isinstance(found, BoardInCloud) else None,
            )
        )
    return camera, board, pairs


def test_a_camera_by_odd_poses_holds_for_even_ones_and_a_shift_is_found(poses: Any) -> None:
    camera, board, pairs = poses
    found = calibrate_camera_lidar(pairs[0::2], camera, board, _PLATE_M)
    assert found.T_camera_lidar is not None
    T_base_camera = np.asarray(np.linalg.inv(found.T_camera_lidar), dtype=np.float64)
    boards = CameraBoards(
        camera="cam",
        lidar="velodyne",
        model=camera,
        pairs=pairs[1::2],
        board=board,
        plate_size_m=_PLATE_M,
    )
    held = check_calibration({"velodyne": np.eye(4), "cam": T_base_camera}, boards=[boards])
    assert held.verdict.exit_code == 0
    assert not held.pairs[0].moved
    assert len(held.pairs[0].judged) >= 5
    assert all(c.detected and c.held_out for c in held.pairs[0].measured.controls.values())
    for axis in ("x", "yaw"):
        off = apply_step(T_base_camera, _step(axis, 0.05, 1.0))
        result = check_calibration({"velodyne": np.eye(4), "cam": off}, boards=[boards])
        assert result.verdict is Verdict.BAD
        assert result.pairs[0].axes[axis].verdict == "moved"
        assert sorted(result.suspects) == [("cam",), ("velodyne",)]
