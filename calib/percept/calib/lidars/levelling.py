"""The large planes around a sensor, each of which can level its cloud.

A pair of planes, one of each sensor, that are the same surface fixes roll, pitch and height of
one sensor against the other; the ground is the pair that nearly every vehicle sees. The sensor
may be tilted by any angle, so nothing is assumed about the axes: a normal points to the sensor's
side, because a LiDAR sees only one side of a surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.registration import thin

__all__ = ["LevelPlane", "find_planes"]

_F64 = NDArray[np.float64]
_VOXEL_M = 0.4  # counts area instead of points
_REACH_M = 30.0
_DRAWS = 2500
_LEAST_AREA_M2 = 1.0
_ON_PLANE_M = 0.12
_FEWEST_POINTS = 40
_MOST_POINTS = 5000
_AT_ORIGIN_M = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class LevelPlane:
    """A plane ``normal @ p + height = 0`` around a sensor.

    Attributes:
        normal: (3,) unit, towards the sensor.
        height_m: Distance of the sensor from it.
        share: Share of the cloud's surface that lies on it.
    """

    normal: _F64
    height_m: float
    share: float

    def levelling(self) -> _F64:
        """Return `T_level_sensor` (4, 4): z is zero on the plane, the sensor over the origin."""
        z = self.normal
        x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.stack([x, np.cross(z, x), z])
        T[2, 3] = self.height_m
        return T


def find_planes(points: _F64, most: int) -> list[LevelPlane]:
    """Return the largest planes of a cloud (N, 3), largest first.

    RANSAC, one plane at a time, on a cloud thinned to one point per voxel.
    """
    near = points[(points**2).sum(axis=1) < _REACH_M**2]
    rest = thin(near, _VOXEL_M) if len(near) else near
    rest = rest[:: max(1, -(-len(rest) // _MOST_POINTS))]
    total = len(rest)
    found: list[LevelPlane] = []
    rng = np.random.default_rng(0)
    while len(found) < most and len(rest) >= max(_FEWEST_POINTS, 0.03 * total):
        plane = _largest_plane(rest, rng)
        if plane is None:
            break
        normal, height = plane
        on_plane = np.abs(rest @ normal + height) < 2 * _ON_PLANE_M
        if on_plane.sum() < _FEWEST_POINTS:
            break
        share = float(on_plane.sum()) / total
        found.append(LevelPlane(normal, height, share))
        if height < _AT_ORIGIN_M:  # which side the sensor is on cannot be told
            found.append(LevelPlane(-normal, -height, share))
        rest = rest[~on_plane]
    return found


def _largest_plane(points: _F64, rng: np.random.Generator) -> tuple[_F64, float] | None:
    """Return normal (3,) and height of the plane with the most points on it."""
    first = rng.integers(len(points), size=_DRAWS)
    others = rng.integers(len(points), size=(_DRAWS, 2))
    a, b, c = points[first], points[others[:, 0]], points[others[:, 1]]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    wide = np.flatnonzero(lengths > _LEAST_AREA_M2)
    if len(wide) == 0:
        return None
    normals = normals[wide] / lengths[wide, None]
    heights = -(normals * a[wide]).sum(axis=1)
    few = points[:: max(1, len(points) // 300)]
    gaps = few @ normals.T
    gaps += heights
    rough = np.count_nonzero(np.abs(gaps, out=gaps) < _ON_PLANE_M, axis=0)
    best = np.argsort(-rough, kind="stable")[:40]
    counts = (np.abs(points @ normals[best].T + heights[best]) < _ON_PLANE_M).sum(axis=0)
    pick = best[int(np.argmax(counts))]
    return _fitted(points, normals[pick], float(heights[pick]))


def _fitted(points: _F64, normal: _F64, height: float) -> tuple[_F64, float]:
    """Fit the plane to what lies on it; the normal points to the sensor."""
    for _ in range(3):
        on_plane = points[np.abs(points @ normal + height) < _ON_PLANE_M]
        if len(on_plane) < 3:
            break
        centre = on_plane.mean(axis=0)
        axis = np.linalg.eigh((on_plane - centre).T @ (on_plane - centre))[1][:, 0]
        normal, height = axis, -float(axis @ centre)
    return (normal, height) if height >= 0 else (-normal, -height)
