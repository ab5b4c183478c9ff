"""A cloud of one sensor with all that is worked out of it, once for all pairs it is part of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.free_space import Seen, what_is_seen
from percept.calib.lidars.levelling import LevelPlane, find_planes
from percept.calib.lidars.registration import Surface, surface
from percept.calib.limits import LidarLimits
from percept.core.errors import GeometryError

__all__ = ["SensorView", "UnusableCloud", "prepare_view"]

_F64 = NDArray[np.float64]

_LIMITS = LidarLimits()
_COARSE_M = 0.4
_COARSE_PROBES = 1500
_MEDIUM_M = 0.2
_MEDIUM_PROBES = 5000
_FINE_PROBES = 15000
_PLANES = 3


@dataclass(frozen=True, slots=True, eq=False)
class SensorView:
    """A cloud, prepared for registration.

    Attributes:
        points: (N, 3) its usable points, metres, in the sensor's frame.
        dropped: Points that were not used, by reason.
        planes: Its largest planes.
        coarse: Its surfaces, thinned to 0.4 m.
        medium: Thinned to 0.2 m.
        fine: Thinned to the finest voxel.
        seen: What the sensor saw and saw through.
    """

    points: _F64
    dropped: Mapping[str, int]
    planes: list[LevelPlane]
    coarse: Surface
    medium: Surface
    fine: Surface
    seen: Seen


@dataclass(frozen=True, slots=True)
class UnusableCloud:
    """A cloud with too little in it.

    Attributes:
        reason: What is wrong with it, as in "cloud has no usable point".
        dropped: As in `SensorView`.
    """

    reason: str
    dropped: Mapping[str, int]


def prepare_view(
    cloud: NDArray[np.floating], *, nearest_m: float, farthest_m: float, voxel_m: float
) -> SensorView | UnusableCloud:
    """Clean a cloud (N, 3 or more) and work out its planes, surfaces and free space.

    Args:
        cloud: x, y, z in metres, the sensor at the origin.
        nearest_m: Nearer points are not used.
        farthest_m: Farther points are not used.
        voxel_m: Finest thinning.

    Raises:
        GeometryError: If it has fewer than three columns.
    """
    points, dropped = _cleaned(cloud, nearest_m, farthest_m)
    if len(points) == 0:
        return UnusableCloud("cloud has no usable point", dropped)
    if len(points) < _LIMITS.fewest_points:
        return UnusableCloud(f"cloud has {len(points)} points only", dropped)
    planes = find_planes(points, _PLANES)
    medium = surface(points, _MEDIUM_M, _MEDIUM_PROBES)
    return SensorView(
        points=points,
        dropped=dropped,
        planes=planes,
        coarse=surface(points, _COARSE_M, _COARSE_PROBES),
        medium=medium,
        fine=surface(points, voxel_m, _FINE_PROBES),
        seen=what_is_seen(points, medium, planes),
    )


def _cleaned(
    cloud: NDArray[np.floating], nearest_m: float, farthest_m: float
) -> tuple[_F64, dict[str, int]]:
    """Return the usable points (N, 3) of a cloud, and how many were left out by reason."""
    points = np.asarray(cloud, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 3:
        raise GeometryError(f"a cloud is (N, 3), not {points.shape}")
    points = points[:, :3]
    finite = np.isfinite(points).all(axis=1)
    points = points[finite]
    ranges = np.linalg.norm(points, axis=1)
    near, far = ranges < nearest_m, ranges > farthest_m
    dropped = {
        "not finite": int((~finite).sum()),
        "too near": int(near.sum()),
        "too far": int(far.sum()),
    }
    return np.ascontiguousarray(points[~near & ~far]), dropped
