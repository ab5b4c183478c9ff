"""A board before a camera and a LiDAR in a room, both with their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from hostile.case import Miss, Outcome, pose
from hostile.lidar_worlds import rays
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib import calibrate_camera_lidar
from percept.calib.board_in_cloud.find import BoardInCloud, find_boards
from percept.calib.boards.definitions import Checkerboard
from percept.calib.boards.views import BoardView
from percept.calib.camera_lidar.calibrate import BoardPair
from percept.core.cameras import Camera, make_camera

__all__ = [
    "BOARD",
    "PLATE_M",
    "T_CAMERA_LIDAR",
    "Setting",
    "calibrated",
    "intrinsics",
    "pairs",
    "with_clouds_of",
]

_F64 = NDArray[np.float64]

BOARD = Checkerboard(7, 5, 0.1)
PLATE_M = (0.9, 0.7)
_SIZE = (1920, 1200)
_FORWARD = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
T_CAMERA_LIDAR = pose(0.1, -0.3, -0.15) @ _FORWARD @ pose(0, 0, 0, 1.0, -2.0, 3.0)
_ROOM = np.array([[-3.0, -6, -1.5], [9.0, 5, 3.0]])
_RAYS = rays(32, 400, (-25, 15), (-50, 50))


def intrinsics(focal: float = 1.0, right_px: float = 0.0) -> Camera:
    """Return the camera, or what a wrong file says of it."""
    K = np.array([[1200 * focal, 0, 960 + right_px], [0, 1200 * focal, 600], [0, 0, 1]])
    return make_camera("pinhole", _SIZE, K, [-0.1, 0.02, 0, 0, 0])


@dataclass(frozen=True, slots=True)
class Setting:
    """How boards stand and what the LiDAR does.

    Attributes:
        seed: Of poses and noise.
        count: Poses.
        tilt_deg: Largest turn of a board about its two axes.
        still: Whether the board stays where it is.
        plate_m: Width and height of the plate.
        given_m: What is said of them.
        bias_m: What the LiDAR adds to each range.
        panel: Whether a second plate of the same size hangs in the view and moves too.
        upside_down: Whether the LiDAR is mounted with its top below.
        moves_at: Pose from which on the LiDAR sits 5 cm and 1 deg elsewhere.
        board: Whether there is a board at all before the LiDAR.
        square_m: Side of a printed square.
        off_centre_m: How far the pattern is from the plate's middle, along its columns.
        roll_deg: Largest turn of a board within the image.
        shake_m: How far the board moves between image and cloud, to any side.
    """

    seed: int = 0
    count: int = 12
    tilt_deg: float = 35.0
    still: bool = False
    plate_m: tuple[float, float] = PLATE_M
    given_m: tuple[float, float] = PLATE_M
    bias_m: float = 0.0
    panel: bool = False
    upside_down: bool = False
    moves_at: int | None = None
    board: bool = True
    square_m: float = BOARD.square_m
    off_centre_m: float = 0.0
    roll_deg: float = 40.0
    shake_m: float = 0.0

    def truth(self, k: int = 0) -> _F64:
        """Return the truth for a pose."""
        T: _F64 = T_CAMERA_LIDAR @ pose(0, 0, 0, 180 if self.upside_down else 0, 0, 0)
        if self.moves_at is not None and k >= self.moves_at:
            T = pose(0.05, 0, 0, 0, 1.0, 0) @ T
        return T


@cache
def pairs(setting: Setting) -> tuple[BoardPair, ...]:
    """Return what both sensors see of the board, found in the raw clouds."""
    rng = np.random.default_rng(setting.seed)
    camera = intrinsics()
    first = _pose(rng, camera, setting)
    poses = [
        first if setting.still or k == 0 else _pose(rng, camera, setting)
        for k in range(setting.count)
    ]
    names = [f"pose{k}" for k in range(setting.count)]
    views = [_view(rng, camera, setting, T, name) for T, name in zip(poses, names, strict=True)]
    clouds = [_cloud(rng, setting, k, T) for k, T in enumerate(poses)]
    boards = find_boards(clouds, names, setting.given_m)
    return tuple(
        BoardPair(name, view, board if isinstance(board, BoardInCloud) else None)
        for name, view, board in zip(names, views, boards, strict=True)
    )


def _pose(rng: np.random.Generator, camera: Camera, setting: Setting) -> _F64:
    """Return T_camera_plate of a board that the camera sees whole."""
    half = np.array([*PLATE_M, 0]) / 2
    rim = half * [[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]]
    while True:
        roll, pitch = setting.tilt_deg * rng.uniform(-1, 1, 2)
        T = pose(0, 0, 0, roll, pitch, setting.roll_deg * rng.uniform(-1, 1))
        ray = camera.unproject(rng.uniform([0, 0], _SIZE, (1, 2)))[0]
        T[:3, 3] = ray * rng.uniform(1.8, 4.5)
        above_floor = (rim @ T[:3, :3].T + T[:3, 3])[:, 1].max() < 0.9
        if camera.project(rim @ T[:3, :3].T + T[:3, 3])[1].all() and above_floor:
            return T


def _view(
    rng: np.random.Generator, camera: Camera, setting: Setting, T: _F64, name: str
) -> BoardView:
    corners = replace(BOARD, square_m=setting.square_m).corners_board()
    corners = corners - corners.mean(axis=0) + [setting.off_centre_m, 0, 0]
    corners = corners @ T[:3, :3].T + T[:3, 3]
    pixels, _ = camera.project(corners)
    noisy = pixels + rng.normal(0, 0.1, pixels.shape)
    return BoardView(name, _SIZE, np.arange(len(noisy)), noisy)


def _cloud(rng: np.random.Generator, setting: Setting, k: int, T_camera_plate: _F64) -> _F64:
    """Return the room and the plates in the LiDAR's frame, with 1 cm of range noise."""
    T_lidar_camera = np.linalg.inv(setting.truth(k))
    moved = rng.normal(0, setting.shake_m / np.sqrt(3), 3)
    # The room belongs to the camera, so that it stays where it is when the LiDAR moves.
    R_room = (np.linalg.inv(_FORWARD) @ setting.truth(k))[:3, :3]
    directions = _RAYS @ np.diag([1.0, -1, -1]) if setting.upside_down else _RAYS
    in_room = directions @ R_room.T
    ranges = np.maximum(_ROOM[0] / in_room, _ROOM[1] / in_room).min(axis=1)
    plates = [T_lidar_camera @ pose(*moved) @ T_camera_plate] if setting.board else []
    if setting.panel:
        plates.append(plates[0] @ pose(1.4, 0.1 * (-1) ** k, 0.3, 5, 20, 8))
    for T in plates:
        t = (T[:3, 2] @ T[:3, 3]) / (directions @ T[:3, 2])
        x, y = ((directions * t[:, None] - T[:3, 3]) @ T[:3, :2]).T
        on = (np.abs(x) < setting.plate_m[0] / 2) & (np.abs(y) < setting.plate_m[1] / 2)
        ranges = np.where(on & (t > 0) & (t < ranges), t, ranges)
    measured = ranges + setting.bias_m + rng.normal(0, 0.01, len(ranges))
    cloud: _F64 = directions * measured[:, None]
    return cloud


def calibrated(
    given: Sequence[BoardPair],
    truth: _F64 | None = T_CAMERA_LIDAR,
    *,
    camera: Camera | None = None,
    board: Checkerboard = BOARD,
    plate_m: tuple[float, float] = PLATE_M,
) -> Outcome:
    """Calibrate and compare with the truth; None where the data have none."""
    result = calibrate_camera_lidar(given, camera or intrinsics(), board, plate_m)
    said, why = str(result.verdict), result.why[0] if result.why else ""
    T, sd_deg, sd_m = result.T_camera_lidar, result.sd_rotation_deg, result.sd_translation_m
    if T is None or sd_deg is None or sd_m is None:
        return Outcome(said, why)
    if truth is None:
        return Outcome(said, why, (Miss("what has no answer", np.inf, 0.0, 0.0, np.inf),))
    turn = np.degrees(Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude())
    # Of the LiDAR's origin, which the covariance keeps in place under the rotation.
    shift = np.linalg.norm(T[:3, 3] - truth[:3, 3])
    return Outcome(
        said,
        why,
        (
            Miss("rotation (deg)", float(turn), float(np.linalg.norm(sd_deg)), 0.2, 1.0),
            Miss("translation (m)", float(shift), float(np.linalg.norm(sd_m)), 0.015, 0.05),
        ),
    )


def with_clouds_of(given: Sequence[BoardPair], order: Sequence[int]) -> list[BoardPair]:
    """Return pairs whose clouds are those of others."""
    return [replace(pair, board=given[k].board) for pair, k in zip(given, order, strict=True)]
