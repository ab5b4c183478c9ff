"""Where the board is held: all over the image, near and far, turned both ways.

As capture guides ask for it: the pattern reaches all corners of the image, fills it from
near, and is tilted by up to 45 degrees about both axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.calib_board import BOARD, plate_corners_board
from percept.datasets.synthetic.terrain import Profile

__all__ = ["draw_poses"]

_ANCHORS = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (0, -1), (0, 1), (-1, 0), (1, 0))
_NEAREST_M, _LARGEST_TILT_RAD, _LARGEST_ROLL_RAD = 1.35, float(np.radians(45)), 0.25
_BORDER_PX = 3.0
_CLEARANCE_M = 0.08
_SHARES = np.linspace(1.0, 0.0, 41)
_NEARER = 0.9


def draw_poses(
    camera: Camera,
    T_map_cams: list[Transform],
    profile: Profile,
    farthest_m: float,
    rng: np.random.Generator,
) -> list[Transform]:
    """Return one `T_map_board` for every `T_map_cam`: the pattern lies in the image as a whole.

    Args:
        camera: The camera that the board is shown to.
        T_map_cams: Its place at each pose.
        profile: The road; no board reaches into it.
        farthest_m: Largest distance.
        rng: Source of the draw.
    """
    count = len(T_map_cams)
    strata = (np.arange(count) + rng.uniform(0, 1, count)) / count
    # Each stratified, and each in an order of its own.
    distances = _NEAREST_M * (farthest_m / _NEAREST_M) ** rng.permutation(strata)
    tilts = _LARGEST_TILT_RAD * np.sqrt(rng.permutation(strata))
    axes = 2 * np.pi * rng.permutation(strata)
    rolls = rng.uniform(-_LARGEST_ROLL_RAD, _LARGEST_ROLL_RAD, count)
    poses = []
    for n, T_map_cam in enumerate(T_map_cams):
        turn = _tilt(float(axes[n]), float(tilts[n])) @ rotation_from_rpy(0, 0, float(rolls[n]))
        anchor = np.array(_ANCHORS[n % len(_ANCHORS)], dtype=np.float64)
        poses.append(_fitted(camera, T_map_cam, profile, anchor, float(distances[n]), turn))
    return poses


def _fitted(
    camera: Camera,
    T_map_cam: Transform,
    profile: Profile,
    anchor: NDArray[np.float64],
    distance_m: float,
    turn: NDArray[np.float64],
) -> Transform:
    """Return the pose farthest towards an anchor of the image that the image and ground allow."""
    size = np.array(camera.image_size, dtype=np.float64)
    while distance_m > 1.0:
        for share in _SHARES:
            pixel = (size - 1) / 2 + share * anchor * size / 2
            T_map_board = T_map_cam @ _at_pixel(camera, pixel, distance_m, turn, T_map_cam.source)
            if _in_image(camera, T_map_cam, T_map_board) and _above(profile, T_map_board):
                return T_map_board
        distance_m *= _NEARER
    return _fitted(camera, T_map_cam, profile, anchor * 0, 2 * _NEAREST_M, np.eye(3))


def _at_pixel(
    camera: Camera,
    pixel: NDArray[np.float64],
    distance_m: float,
    turn: NDArray[np.float64],
    frame: str,
) -> Transform:
    """Return `T_cam_board` with the plate's centre on a pixel's ray, turned from facing it."""
    ray = camera.unproject(pixel[None])[0]
    rotation = _towards(ray) @ turn
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = distance_m * ray - rotation @ BOARD.corners_board().mean(axis=0)
    return Transform(frame, "board", matrix)


def _towards(ray: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest rotation from the optical axis to a unit ray (Rodrigues)."""
    axis = np.cross([0.0, 0.0, 1.0], ray)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3)
    return _about(axis / sine, float(np.arctan2(sine, ray[2])))


def _tilt(direction_rad: float, angle_rad: float) -> NDArray[np.float64]:
    return _about(np.array([np.cos(direction_rad), np.sin(direction_rad), 0.0]), angle_rad)


def _about(axis: NDArray[np.float64], angle_rad: float) -> NDArray[np.float64]:
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: NDArray[np.float64] = (
        np.eye(3) + np.sin(angle_rad) * skew + (1 - np.cos(angle_rad)) * skew @ skew
    )
    return turn


def _in_image(camera: Camera, T_map_cam: Transform, T_map_board: Transform) -> bool:
    """Return whether the outer squares lie in the image, a few pixels from its border."""
    side = BOARD.square_m
    low, high = np.array([-side, -side]), np.array([BOARD.columns, BOARD.rows]) * side
    edge = np.linspace(0, 1, 9)[:, None]
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    outline = np.concatenate(
        [a + edge * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    points = np.column_stack([outline, np.zeros(len(outline))])
    pixels, seen = camera.project((T_map_cam.inverse() @ T_map_board).apply(points))
    inside = (pixels >= _BORDER_PX) & (pixels <= np.array(camera.image_size) - 1 - _BORDER_PX)
    return bool(seen.all() and inside.all())


def _above(profile: Profile, T_map_board: Transform) -> bool:
    corners = T_map_board.apply(plate_corners_board())
    return bool((corners[:, 2] - profile.ground(corners[:, 0], corners[:, 1]) > _CLEARANCE_M).all())
