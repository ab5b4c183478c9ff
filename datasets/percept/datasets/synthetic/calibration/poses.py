"""Where the board is held: all over the image, near and far, turned both ways.

As capture guides ask for it: the pattern reaches all corners of the image, fills it from
near, and is tilted by up to 45 degrees about both axes. The plate stays in the view of the LiDAR
that the camera is placed by, too, but for a few poses that the upper corners of the image need.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.calibration.board import BOARD, plate_corners_board
from percept.datasets.synthetic.terrain import Profile

__all__ = ["LidarView", "draw_poses"]

_ANCHORS = ((0, 0), (-1, -1), (1, 1), (1, -1), (-1, 1), (0, -1), (0, 1), (-1, 0), (1, 0))
_NEAREST_M, _LARGEST_TILT_RAD, _LARGEST_ROLL_RAD = 1.35, float(np.radians(45)), 0.5
_BORDER_PX = 3.0
_CLEARANCE_M = 0.08
_SHARES_X, _SHARES_Y = np.linspace(1.0, 0.0, 13), np.linspace(-1.0, 1.0, 25)
_FARTHER, _TOO_FAR_M = 1.1, 10.0
_CENTRE_BOARD = BOARD.corners_board().mean(axis=0)
_HIGH_EVERY, _HIGH_FIRST, _HIGH_FARTHEST = 11, 1, 1.25
_RAYS_ABOVE_RAD = float(np.radians(1.5))
_LARGEST_SHARE_BELOW = 0.25


@dataclass(frozen=True, slots=True)
class LidarView:
    """What a LiDAR sees, as seen from a camera.

    Attributes:
        T_cam_lidar: Its place.
        lowest_rad: Elevation of its lowest beam.
        highest_rad: Elevation of its highest beam.
    """

    T_cam_lidar: Transform
    lowest_rad: float
    highest_rad: float

    def sees(self, T_cam_board: Transform) -> bool:
        """Return whether beams pass above the plate and meet most of it."""
        T = np.linalg.solve(self.T_cam_lidar.matrix, T_cam_board.matrix)
        corners = plate_corners_board() @ T[:3, :3].T + T[:3, 3]
        elevations = np.arctan2(corners[:, 2], np.hypot(corners[:, 0], corners[:, 1]))
        below = (self.lowest_rad - elevations.min()) / np.ptp(elevations)
        above = self.highest_rad - elevations.max()
        return bool(above > _RAYS_ABOVE_RAD and below < _LARGEST_SHARE_BELOW)


def draw_poses(
    camera: Camera,
    lidar: LidarView,
    T_map_cams: list[Transform],
    profile: Profile,
    farthest_m: float,
    rng: np.random.Generator,
) -> list[Transform]:
    """Return one `T_map_board` for every `T_map_cam`: the pattern lies in the image as a whole.

    Args:
        camera: The camera that the board is shown to.
        lidar: The LiDAR that sees most of the boards too; every eleventh is shown from near,
            high in the image, where it need not.
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
        high = n % _HIGH_EVERY == _HIGH_FIRST
        anchor = np.array(_ANCHORS[n % len(_ANCHORS)], dtype=np.float64)
        distance_m = min(distances[n], _HIGH_FARTHEST * _NEAREST_M) if high else distances[n]
        room = _Room(camera, None if high else lidar, T_map_cam, profile)
        poses.append(_fitted(room, anchor, float(distance_m), turn))
    return poses


@dataclass(frozen=True, slots=True)
class _Room:
    """What a pose of the board has to fit into; without a LiDAR only the image and the ground."""

    camera: Camera
    lidar: LidarView | None
    T_map_cam: Transform
    profile: Profile

    def holds(self, T_cam_board: Transform) -> bool:
        return (
            (self.lidar is None or self.lidar.sees(T_cam_board))
            and _in_image(self.camera, T_cam_board)
            and _above(self.profile, self.T_map_cam @ T_cam_board)
        )


def _fitted(
    room: _Room, anchor: NDArray[np.float64], distance_m: float, turn: NDArray[np.float64]
) -> Transform:
    """Return the pose farthest towards an anchor of the image that all allow, sideways first.

    Where none does, the board goes away: it then is smaller for both sensors.
    """
    size = np.array(room.camera.image_size, dtype=np.float64)
    towards_y = _SHARES_Y[np.argsort(np.abs(_SHARES_Y - anchor[1]), kind="stable")]
    shares = np.array([(x, y) for x in _SHARES_X * anchor[0] for y in towards_y])
    rays = room.camera.unproject((size - 1) / 2 + shares * size / 2)
    while distance_m < _TOO_FAR_M:
        for ray in rays[np.isfinite(rays).all(axis=1)]:
            T_cam_board = _on_ray(ray, distance_m, turn, room.T_map_cam.source)
            if room.holds(T_cam_board):
                return room.T_map_cam @ T_cam_board
        distance_m *= _FARTHER
    return _fitted(room, np.zeros(2), 2 * _NEAREST_M, np.eye(3))


def _on_ray(
    ray: NDArray[np.float64], distance_m: float, turn: NDArray[np.float64], frame: str
) -> Transform:
    """Return `T_cam_board` with the plate's centre on a ray, turned from facing it."""
    rotation = _towards(ray) @ turn
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = distance_m * ray - rotation @ _CENTRE_BOARD
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


def _in_image(camera: Camera, T_cam_board: Transform) -> bool:
    """Return whether the outer squares lie in the image, a few pixels from its border."""
    side = BOARD.square_m
    low, high = np.array([-side, -side]), np.array([BOARD.columns, BOARD.rows]) * side
    edge = np.linspace(0, 1, 9)[:, None]
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    outline = np.concatenate(
        [a + edge * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    )
    points = np.column_stack([outline, np.zeros(len(outline))])
    pixels, seen = camera.project(T_cam_board.apply(points))
    inside = (pixels >= _BORDER_PX) & (pixels <= np.array(camera.image_size) - 1 - _BORDER_PX)
    return bool(seen.all() and inside.all())


def _above(profile: Profile, T_map_board: Transform) -> bool:
    corners = T_map_board.apply(plate_corners_board())
    return bool((corners[:, 2] - profile.ground(corners[:, 0], corners[:, 1]) > _CLEARANCE_M).all())
