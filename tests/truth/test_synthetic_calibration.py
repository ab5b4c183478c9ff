"""The synthetic calibration: boards stand where the truth says, in scans and in images."""

from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.core.rig import load_rig
from percept.core.samples import CameraImage, CameraInfo, PointCloud, TransformSample
from percept.core.transform import Transform
from percept.datasets import open_recording
from percept.datasets.synthetic.calibration.board import (
    BOARD,
    BOARD_ID,
    PLATE_SIZE_M,
    plate_corners_board,
)
from percept.datasets.synthetic.calibration.capture import CalibrationConfig, Capture
from percept.datasets.synthetic.calibration.course import BoardHold
from percept.datasets.synthetic.calibration.log import BOARD_COLUMNS, generate_calibration
from percept.datasets.synthetic.drive import START_NS

SMALL = CalibrationConfig(seed=4, stops=2, poses=6)
_CENTRE_BOARD = BOARD.corners_board().mean(axis=0)


@pytest.fixture(scope="module")
def capture() -> Capture:
    return Capture(SMALL)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A written calibration log with small images and few beams."""
    out = tmp_path_factory.mktemp("calib") / "out"
    config = CalibrationConfig(seed=4, stops=1, poses=2, image_size=(320, 200), beam_share=0.2)
    generate_calibration(config, out)
    return out


def _points_on_board(capture: Capture, sensor: int, hold: BoardHold) -> NDArray[np.float64]:
    """Return the points of a scan in the middle of a hold that met the board, in its frame."""
    number = int(np.ceil(hold.start_s / 0.2))
    scan = capture.scan(sensor, number)
    time_s = (scan.stamp_ns - START_NS) / 1e9
    assert hold.start_s < time_s < hold.end_s
    T_map_base = capture.motion.poses(np.array([time_s]))[0]
    T_board_sensor = (
        np.linalg.inv(hold.T_map_board.matrix)
        @ T_map_base
        @ capture.lidars[sensor].T_base_sensor.matrix
    )
    points = scan.points_sensor[scan.object_ids == BOARD_ID]
    points_board: NDArray[np.float64] = points @ T_board_sensor[:3, :3].T + T_board_sensor[:3, 3]
    return points_board


def test_exact_returns_of_the_board_lie_on_its_face() -> None:
    exact = Capture(SMALL.model_copy(update={"noise": 0.0}))
    counted = 0
    for hold in exact.holds:
        points = _points_on_board(exact, 0, hold)
        inside = np.abs(points[:, :2] - _CENTRE_BOARD[:2]) <= np.array(PLATE_SIZE_M) / 2 + 1e-9
        face = points[inside.all(axis=1) & (points[:, 2] < 0.05)]  # the stand is behind
        # The printed face, or the edge of the plate behind it.
        assert ((face[:, 2] > -2e-6) & (face[:, 2] < 0.0101)).all()
        assert (np.abs(face[:, 2]) < 2e-6).sum() >= 0.9 * len(face)
        counted += len(face) > 50
    assert counted >= 4


def test_noisy_returns_of_the_board_scatter_about_its_face(capture: Capture) -> None:
    depths = []
    for hold in capture.holds:
        points = _points_on_board(capture, 0, hold)
        depths.append(points[np.abs(points[:, 2]) < 0.07, 2])
    off = np.concatenate(depths)
    assert abs(off.mean()) < 0.003
    assert 0.010 < off.std() < 0.022  # 2 cm along the ray, less across the plate


def test_black_squares_are_darker_than_white_ones() -> None:
    exact = Capture(SMALL.model_copy(update={"noise": 0.0}))
    hold = exact.holds[0]
    scan = exact.scan(0, int(np.ceil(hold.start_s / 0.2)))
    points = _points_on_board(exact, 0, hold)
    bright = scan.intensity[scan.object_ids == BOARD_ID]
    column, row = np.floor(points[:, :2] / BOARD.square_m).astype(int).T + 1
    pattern = (column >= 0) & (column < 10) & (row >= 0) & (row < 7) & (points[:, 2] < 1e-5)
    black = (column + row) % 2 == 0
    assert (pattern & black).sum() > 20
    assert bright[pattern & black].max() < bright[pattern & ~black].min()


def test_detected_corners_lie_where_the_truth_projects_them(capture: Capture) -> None:
    camera = capture.cameras[0]
    for hold in capture.holds[:4]:
        time_s = hold.start_s + 0.3
        grey = cv2.cvtColor(capture.image(camera, time_s), cv2.COLOR_BGR2GRAY)
        jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
        grey = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE))  # as the log carries it
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        found, corners = cv2.findChessboardCorners(grey, (9, 6), flags=flags)
        assert found
        T_cam_board = capture.camera_pose(camera, time_s).inverse() @ hold.T_map_board
        expected, seen = camera.camera().project(T_cam_board.apply(BOARD.corners_board()))
        assert seen.all()
        apart = np.linalg.norm(np.diff(expected.reshape(6, 9, 2), axis=1), axis=2).min()
        window = int(np.clip(apart / 2, 2, 11))
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-3)
        fine = cv2.cornerSubPix(grey, corners, (window, window), (-1, -1), criteria)
        off = np.linalg.norm(fine.reshape(-1, 2) - expected, axis=1)
        assert np.sqrt((off**2).mean()) < 0.1
        assert off.max() < 0.2


def test_the_pattern_reaches_all_over_the_image() -> None:
    many = Capture(CalibrationConfig(seed=9))
    camera = many.cameras[0]
    pixels = []
    tilts = []
    for hold in many.holds:
        T_cam_board = many.camera_pose(camera, hold.start_s).inverse() @ hold.T_map_board
        corners, seen = camera.camera().project(T_cam_board.apply(BOARD.corners_board()))
        assert seen.all()
        pixels.append(corners)
        ray = T_cam_board.apply(_CENTRE_BOARD[None])[0]
        facing = float(T_cam_board.rotation[:, 2] @ ray / np.linalg.norm(ray))
        tilts.append(np.degrees(np.arccos(facing)))
    width, height = camera.image_size
    cells = np.floor(np.concatenate(pixels) / [width / 6, height / 4]).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 24
    assert min(tilts) < 12
    assert 40 < max(tilts) <= 45.1


def test_the_reference_lidar_sees_all_boards_but_those_high_in_the_image() -> None:
    many = Capture(CalibrationConfig(seed=9))
    top = many.lidars[0]
    unseen = 0
    for hold in many.holds:
        T_map_base = Transform("map", "base_link", many.motion.poses(np.array([hold.start_s]))[0])
        T_lidar_board = (T_map_base @ top.T_base_sensor).inverse() @ hold.T_map_board
        corners = T_lidar_board.apply(plate_corners_board())
        elevations = np.arctan2(corners[:, 2], np.hypot(corners[:, 0], corners[:, 1]))
        unseen += bool(elevations.max() > top.elevations_rad.max())
    assert 1 <= unseen <= 3


def test_the_same_seed_gives_the_same_samples_and_another_one_others() -> None:
    def digest(seed: int) -> str:
        config = SMALL.model_copy(
            update={"seed": seed, "poses": 1, "stops": 1, "image_size": (96, 64), "beam_share": 0.1}
        )
        state = hashlib.sha256()
        for sample in Capture(config).samples():
            state.update(f"{sample.topic} {sample.stamp_ns} {sample.log_time_ns}".encode())
            if isinstance(sample, PointCloud):
                state.update(sample.points_xyz.tobytes())
            elif isinstance(sample, CameraImage):
                state.update(sample.pixels.tobytes())
            elif isinstance(sample, TransformSample):
                state.update(sample.T_frame_child.matrix.tobytes())
        return state.hexdigest()

    assert digest(1) == digest(1)
    assert digest(2) != digest(1)


def test_the_vehicle_stands_while_a_board_is_held(capture: Capture) -> None:
    for hold in capture.holds:
        first, last = capture.motion.poses(np.array([hold.start_s - 0.4, hold.end_s]))
        assert np.array_equal(first, last)
    course = capture.motion.course
    between = np.diff(capture.motion.poses(np.array(course.arrive_s))[:, :3, 3], axis=0)
    assert (np.linalg.norm(between, axis=1) > 7.5).all()


def test_the_start_rig_is_wrong_in_everything_but_the_reference(written: Path) -> None:
    start, exact = load_rig(written / "rig.yaml"), load_rig(written / "truth" / "rig.yaml")
    degrees = {}
    for name, sensor in exact.sensors.items():
        placed, wrong = sensor.T_base_sensor, start.sensors[name].T_base_sensor
        assert placed is not None
        assert wrong is not None
        off = placed.inverse().matrix @ wrong.matrix
        degrees[name] = np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
        if name == "lidar_top":
            assert np.array_equal(placed.matrix, wrong.matrix)
        else:
            assert 0.05 <= np.linalg.norm(off[:3, 3]) <= 0.12
    assert degrees["lidar_left"] == pytest.approx(45)
    assert all(1.5 < degrees[n] < 6.5 for n in ("lidar_right", "lidar_front", "cam_front"))
    rough, true = (rig.cameras()["cam_front"] for rig in (start, exact))
    assert abs(rough.K[0] / true.K[0] - 1) == pytest.approx(0.03)
    assert not any(rough.distortion)


def test_the_log_says_what_the_start_rig_says(written: Path) -> None:
    start = load_rig(written / "rig.yaml")
    with open_recording(written / "calib.mcap") as recording:
        samples = list(recording.samples(topics=["/tf_static", "/cam_front/camera_info"]))
    checked = 0
    for sample in samples:
        if isinstance(sample, TransformSample) and sample.T_frame_child.source in start.sensors:
            placed = start.sensors[sample.T_frame_child.source].T_base_sensor
            assert placed is not None
            assert np.abs(placed.matrix - sample.T_frame_child.matrix).max() < 1e-9
            checked += 1
        elif isinstance(sample, CameraInfo):
            assert sample.K[0, 0] == start.cameras()["cam_front"].K[0]
    assert checked == 5


def test_the_truth_files_tell_where_the_board_was(written: Path) -> None:
    rows = pq.read_table(written / "truth" / "boards.parquet")
    assert rows.schema.names == BOARD_COLUMNS.names
    assert rows.num_rows == 2
    config = CalibrationConfig(seed=4, stops=1, poses=2, image_size=(320, 200), beam_share=0.2)
    for row, hold in zip(rows.to_pylist(), Capture(config).holds, strict=True):
        T_map_board = Transform.from_quat_xyzw(
            "map", "board", [row[k] for k in "xyz"], [row[f"q{k}"] for k in "xyzw"]
        )
        assert np.abs(T_map_board.matrix - hold.T_map_board.matrix).max() < 1e-9
        assert row["end_ns"] - row["start_ns"] == 600_000_000
    board = yaml.safe_load((written / "board.yaml").read_text(encoding="utf-8"))
    assert board == {"board": "checkerboard:9x6:0.1", "board_size": "1.2x0.9"}


def test_every_camera_gets_its_poses_and_its_images() -> None:
    config = CalibrationConfig(
        seed=2, stops=1, poses=2, cameras=("cam_front", "cam_left"), image_size=(96, 64),
        beam_share=0.1,
    )  # fmt: skip
    capture = Capture(config)
    assert [hold.camera for hold in capture.holds] == ["cam_front"] * 2 + ["cam_left"] * 2
    stamps = {
        camera: [s.stamp_ns for s in capture.samples() if s.topic == f"/{camera}/camera_info"]
        for camera in config.cameras
    }
    for hold in capture.holds:
        for camera, seen in stamps.items():
            inside = [s for s in seen if hold.start_s < (s - START_NS) / 1e9 < hold.end_s]
            assert len(inside) == int(camera == hold.camera)


def test_fewer_poses_than_stops_are_refused() -> None:
    with pytest.raises(UsageError, match="2 poses of the board for 3 stops"):
        Capture(CalibrationConfig(stops=3, poses=2))
