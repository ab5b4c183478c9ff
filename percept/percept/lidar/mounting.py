"""How a LiDAR is mounted: its height over the ground and its tilt, from its clouds alone.

The ground near a vehicle is the near-horizontal plane with the most area on it and little below
it. Counting area instead of points keeps the dense rings around the sensor and walls at close
range from outvoting it; counting what lies below keeps car roofs, tables and ceilings from
winning. A sensor that hangs upside down sees the same thing with z reversed, so
"below" means beyond the plane as seen from the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import ConfigError, GeometryError
from percept.core.transform import Transform
from percept.lidar.points import as_points

__all__ = ["HIGHEST_SENSOR_M", "Mounting", "check_sensor_height", "estimate_mounting"]

HIGHEST_SENSOR_M = 5.0

_LARGEST_TILT_DEG = 25.0  # 20 deg of mounting and some slope under the wheels
_NEAREST_M = 2.5  # nearer points are the vehicle's own roof and bonnet
_FARTHEST_M = 40.0
_LOCAL_M = 6.0  # from here on the ground's own shape counts for more than its points tell
_CELL_M = 0.5
_TRIPLES = 3000
_MOST_PLANES = 250
_MOST_POINTS = 3000
_LEAST_AREA_M2 = 4.0  # a smaller triple says nothing about a plane's tilt
_ON_PLANE_M = 0.12
_BELOW_PLANE_M = 0.35
_BELOW_COST = 0.5  # less than 1: a road on a dam has wide fields below it
_UPSIDE_DOWN_ODDS = 0.8  # under a roof both ways up look alike
_FEWEST_POINTS = 60
_LEAST_SHARE = 0.12
_AT_ORIGIN_M = 0.15  # within this of the plane, a sensor's side of it cannot be told
_REMEDY = "Give --sensor-height or a rig"

_F32 = NDArray[np.float32]
_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """A sensor's place over the ground.

    Attributes:
        height_m: Height of the sensor's origin over the ground that is worked with.
        found_height_m: Height over the ground plane that the clouds show; NaN where none was
            found. It differs from `height_m` where the user gave another.
        T_level_sensor: Rotation of the sensor frame into a frame with the same origin whose z is
            the ground's normal and whose x is the sensor's x laid onto the ground.
        tilt_deg: Angle between the sensor's z axis (its -z when mounted upside down) and z up.
        upside_down: Whether the sensor's z axis points at the ground.
        inlier_share: Share of the near surface (one point per cell) that lies on the plane.
        sd_height_m: Spread of the height: between clouds, or of the plane's points for one cloud.
        clouds_used: Clouds in which the plane was found.
    """

    height_m: float
    found_height_m: float
    T_level_sensor: Transform
    tilt_deg: float
    upside_down: bool
    inlier_share: float
    sd_height_m: float
    clouds_used: int


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    """The points p with ``normal @ p + height = 0``; the normal (3,) points up."""

    normal: _F64
    height: float
    share: float
    residual: float


def check_sensor_height(height_m: float, where: object = "sensor height") -> float:
    """Return a sensor's height over the ground, or refuse one that no vehicle has.

    Clouds in a vehicle's base frame have heights near 0 (0.2 to 0.4 m in an axle frame).

    Raises:
        ConfigError: Unless 0 <= height_m <= 5.
    """
    if not 0.0 <= height_m <= HIGHEST_SENSOR_M:
        raise ConfigError(
            f"a sensor {height_m:.2f} m over the ground cannot be on a vehicle",
            where=where,
            remedy=f"Give a height from 0 to {HIGHEST_SENSOR_M:g} m",
        )
    return height_m


def estimate_mounting(clouds: Sequence[NDArray[np.floating]], frame: str = "sensor") -> Mounting:
    """Find the ground plane under a sensor from one or more of its clouds.

    Args:
        clouds: Each (N, 3 or more) x, y, z in the sensor's frame, metres, finite. A handful,
            spread over a drive, averages slopes out.
        frame: Name of the sensor's frame; the level frame is called `<frame>_level`.

    Returns:
        The mounting; median over the clouds in which a plane was found.

    Raises:
        GeometryError: If no ground plane is found in most of the clouds, if they contradict each
            other, or if the height is not one of a vehicle (0 to 5 m).
    """
    found = [plane for cloud in clouds if (plane := _find_plane(as_points(cloud))) is not None]
    if not found or 2 * len(found) < len(clouds):
        raise GeometryError(
            f"no ground plane under the sensor in {len(clouds) - len(found)} of {len(clouds)} "
            f"clouds (within {_LARGEST_TILT_DEG:g} deg of level, {_NEAREST_M:g} to "
            f"{_FARTHEST_M:g} m away)",
            where=frame,
            remedy=_REMEDY,
        )
    upside_down = bool(np.median([plane.normal[2] for plane in found]) < 0)
    agreeing = [plane for plane in found if (plane.normal[2] < 0) == upside_down]
    heights = np.array([plane.height for plane in agreeing])
    height_m = float(np.median(heights))
    if not -_AT_ORIGIN_M <= height_m <= HIGHEST_SENSOR_M:
        raise GeometryError(
            f"the only ground plane lies {height_m:.2f} m under the sensor",
            where=frame,
            remedy=_REMEDY,
        )
    normal = np.median([plane.normal for plane in agreeing], axis=0)
    normal /= np.linalg.norm(normal)
    return Mounting(
        height_m=max(height_m, 0.0),
        found_height_m=max(height_m, 0.0),
        T_level_sensor=_level(normal, frame),
        tilt_deg=float(np.degrees(np.arccos(min(abs(normal[2]), 1.0)))),
        upside_down=upside_down,
        inlier_share=float(np.median([plane.share for plane in agreeing])),
        sd_height_m=float(heights.std(ddof=1)) if len(heights) > 1 else agreeing[0].residual,
        clouds_used=len(agreeing),
    )


def _level(up_sensor: _F64, frame: str) -> Transform:
    """Return the rotation whose z is `up_sensor` (3,) and whose x stays nearest to x."""
    x = np.array([1.0, 0.0, 0.0]) - up_sensor[0] * up_sensor
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(up_sensor, x), up_sensor])
    return Transform(f"{frame}_level", frame, matrix)


def _find_plane(points: NDArray[np.float32]) -> _Plane | None:
    """Return the ground plane of one cloud, or None."""
    near = _thin(points)
    if len(near) < _FEWEST_POINTS:
        return None
    normals, heights = _candidates(near)
    if len(normals) == 0:
        return None
    weights = 1.0 / (1.0 + (near[:, 0] ** 2 + near[:, 1] ** 2) / np.float32(_LOCAL_M**2))
    distances = near @ normals.T + heights
    score = weights @ (np.abs(distances) < _ON_PLANE_M)
    score -= _BELOW_COST * (weights @ (distances < -_BELOW_PLANE_M))
    score *= np.where(normals[:, 2] > 0, 1.0, _UPSIDE_DOWN_ODDS)
    best = int(np.argmax(score))
    if score[best] <= 0:
        return None
    plane = _refined(near, weights, normals[best], heights[best])
    level = abs(plane.normal[2]) >= np.cos(np.radians(_LARGEST_TILT_DEG))
    return plane if level and plane.share >= _LEAST_SHARE else None


def _thin(points: NDArray[np.float32]) -> _F32:
    """Return the lowest and the highest point of each cell (x, y) of the surroundings.

    One of the two is on the ground whichever way up the sensor is, and walls, which would
    outnumber it, shrink to two points a cell.
    """
    with np.errstate(over="ignore"):  # a stray point at 1e30 m is as far as infinity
        squares = points[:, 0] ** 2 + points[:, 1] ** 2
    near = points[(squares > _NEAREST_M**2) & (squares < _FARTHEST_M**2)]
    cells = np.floor(near[:, :2] * np.float32(1.0 / _CELL_M)).astype(np.int32)
    keys = (cells[:, 0] + 1024) * 2048 + cells[:, 1] + 1024
    order = np.lexsort((near[:, 2], keys))
    new_cell = np.diff(keys[order], prepend=-1, append=-1) != 0
    kept = near[order[new_cell[:-1] | new_cell[1:]]]
    thinned: _F32 = kept[:: max(1, -(-len(kept) // _MOST_POINTS))]
    return thinned


def _candidates(points: _F32) -> tuple[_F32, _F32]:
    """Return normals (K, 3) and heights (K,) of planes through random triples, level enough.

    The normal points to the sensor's side of the plane; where the plane goes through the sensor,
    it points along z.
    """
    triples = points[np.random.default_rng(0).integers(len(points), size=(_TRIPLES, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    level = np.abs(normals[:, 2]) > lengths * np.cos(np.radians(_LARGEST_TILT_DEG))
    level = np.flatnonzero(level & (lengths > _LEAST_AREA_M2))[:_MOST_PLANES]
    normals = normals[level] / lengths[level, None]
    normals *= np.sign(normals[:, 2:])
    heights = -(normals * triples[level, 0]).sum(axis=1)
    side = np.where(heights < -_AT_ORIGIN_M, -1, 1).astype(np.float32)
    return normals * side[:, None], heights * side


def _refined(points: _F32, weights: _F32, normal: _F32, height: float) -> _Plane:
    """Fit the plane to what lies on it by weighted total least squares."""
    near = points.astype(np.float64)
    up = normal.astype(np.float64)
    for _ in range(3):
        weight = np.where(np.abs(near @ up + height) < _ON_PLANE_M, weights, 0.0)
        weight /= weight.sum()
        centre = weight @ near
        offsets = near - centre
        axis = np.linalg.eigh((offsets * weight[:, None]).T @ offsets)[1][:, 0]
        up = axis * np.sign(axis @ up)
        height = -float(up @ centre)
    distances = near @ up + height
    on_plane = np.abs(distances) < _ON_PLANE_M
    return _Plane(
        up, height, float(weights @ on_plane / weights.sum()), float(distances[on_plane].std())
    )
