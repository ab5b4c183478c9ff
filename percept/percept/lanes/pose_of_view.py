"""Where the camera is over the road: from the rig, or from the vanishing point.

The road's frame has x along the lane, y to its left, z up; its origin is on the road below
that of the vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.errors import GeometryError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.lanes.config import LaneConfig
from percept.lanes.vanishing import VanishingPoint, find_segments, find_vanishing_point

__all__ = ["PlacedView", "place_view"]

_F64 = NDArray[np.float64]

_ASSUMED_HEIGHT_M = 1.5  # of the cameras of cars, within a factor of 1.5
_SHORTEST_SHARE = 0.02  # of the image's width that a segment has at least
_RIG_SD_RAD = np.radians([5.0, 2.5])  # of the road's direction against a rig: yaw, pitch
_FREE_SD_SHARE = np.array([0.12, 0.12])  # of the image's width and height
_FREE_ROW_SHARE = 0.45
_AHEAD = 0.1  # of a ray's length that points along the optical axis
_ROAD = "road"


@dataclass(frozen=True, slots=True, eq=False)
class PlacedView:
    """A camera over the road.

    Attributes:
        camera: The camera; its `T_base_sensor` is its place in the road's frame.
        yaw_rad: Direction of the road in the vehicle's frame, to the left.
        pitch_rad: What the vanishing point gave where the rig gave nothing.
        metric: Whether lengths are metres; else the height of the camera is assumed.
        notes: What a reader should know.
    """

    camera: CameraSensor
    yaw_rad: float
    pitch_rad: float
    metric: bool
    notes: tuple[str, ...] = ()

    def to_vehicle(self, points_m: _F64) -> _F64:
        """Return points (N, 2) of the road's frame in the vehicle's."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        turned: _F64 = points_m @ np.array([[c, s], [-s, c]])
        return turned


def place_view(
    gray: NDArray[np.uint8], camera: CameraSensor | None, config: LaneConfig
) -> PlacedView | None:
    """Place the camera over the road; None where neither rig nor image tells how.

    A camera that is not known is taken for a pinhole as wide as its image is far: lateral
    places on the road do not depend on the focal length, only distances along it do.

    Args:
        gray: (H, W) uint8, as recorded.
        camera: The camera with its place on the vehicle, as far as they are known.
        config: Settings.

    Raises:
        GeometryError: If the camera's images have another size, or it is not above the road.
    """
    height, width = gray.shape
    lens = camera or _unknown_camera(width, height)
    if lens.image_size != (width, height):
        have, want = (f"{w}x{h}" for w, h in ((width, height), lens.image_size))
        raise GeometryError(f"the image is {have} and the camera's images are {want}")
    found = find_segments(gray, min_length_px=_SHORTEST_SHARE * width)
    segments = _straight(found, lens.camera())
    if lens.T_base_sensor is not None:
        return _by_rig(segments, lens, lens.T_base_sensor, config)
    column = lens.K[2]
    point = find_vanishing_point(
        segments, np.array([column, _FREE_ROW_SHARE * height]), _FREE_SD_SHARE * [width, height]
    )
    if point is None:
        return None
    metric = camera is not None and config.camera_height_m is not None
    return _by_vanishing_point(point, lens, config.camera_height_m if metric else None)


def _unknown_camera(width: int, height: int) -> CameraSensor:
    return CameraSensor(
        name="camera",
        topic=None,
        frame="camera",
        image_size=(width, height),
        model="pinhole",
        K=(float(width), float(width), (width - 1) / 2, (height - 1) / 2),
        distortion=(0.0,) * 5,
        T_base_sensor=None,
    )


def _straight(segments: _F64, lens: Camera) -> _F64:
    """Return segments (N, 4) as an image without distortion with the same K would show them."""
    rays = lens.unproject(segments.reshape(-1, 2))
    ahead = rays[:, 2] > _AHEAD * np.linalg.norm(rays, axis=1)
    whole = ahead.reshape(-1, 2).all(axis=1)
    rays = rays.reshape(-1, 2, 3)[whole].reshape(-1, 3)
    straight: _F64 = rays[:, :2] / rays[:, 2:] * np.diag(lens.K)[:2] + lens.K[:2, 2]
    return straight.reshape(-1, 4)


def _by_rig(segments: _F64, camera: CameraSensor, T: Transform, config: LaneConfig) -> PlacedView:
    """Return the view of a rig, turned to where the road goes."""
    place = np.array(T.translation_m, dtype=np.float64)
    if config.camera_height_m is not None:
        place[2] = config.camera_height_m
    if place[2] <= 0.1:
        raise GeometryError(
            f"camera '{camera.name}' is {place[2]:.2f} m above the base frame, which should be on "
            "the road",
            remedy="Set camera_height_m",
        )
    ahead = T.rotation[0]
    if ahead[2] < 0.5:
        raise GeometryError(
            f"camera '{camera.name}' does not look ahead", remedy="Take a camera at the front"
        )
    focal, middle = np.array(camera.K[:2]), np.array(camera.K[2:])
    expected = ahead[:2] / ahead[2] * focal + middle
    point = find_vanishing_point(segments, expected, np.tan(_RIG_SD_RAD) * focal)
    if point is None:
        note = "no vanishing point was found: the road is taken to go straight ahead"
        placed = _placed(camera, T.rotation, place)
        return PlacedView(placed, 0.0, 0.0, metric=True, notes=(note,))
    ray = T.rotation @ np.append((point.pixel - middle) / focal, 1.0)
    yaw = float(np.arctan2(ray[1], ray[0]))
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
    return PlacedView(_placed(camera, turn @ T.rotation, turn @ place), yaw, 0.0, metric=True)


def _placed(camera: CameraSensor, rotation: _F64, place_m: _F64) -> CameraSensor:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place_m
    return replace(camera, T_base_sensor=Transform(_ROAD, camera.frame, matrix))


def _by_vanishing_point(
    point: VanishingPoint, camera: CameraSensor, height_m: float | None
) -> PlacedView:
    """Return the view of a camera that is level from side to side, by where lines meet."""
    focal, middle = np.array(camera.K[:2]), np.array(camera.K[2:])
    ahead = np.append((point.pixel - middle) / focal, 1.0)
    ahead /= np.linalg.norm(ahead)
    left = np.cross([0.0, -1.0, 0.0], ahead)
    left /= np.linalg.norm(left)
    rotation = np.array([ahead, left, np.cross(ahead, left)])
    axis = rotation[:, 2]
    note = "the scale is not known: the result is in pixels, and lines go on past their paint"
    return PlacedView(
        _placed(camera, rotation, np.array([0.0, 0.0, height_m or _ASSUMED_HEIGHT_M])),
        yaw_rad=-float(np.arctan2(axis[1], axis[0])),
        pitch_rad=float(np.arcsin(-axis[2])),
        metric=height_m is not None,
        notes=() if height_m is not None else (note,),
    )
