"""How well a transform agrees with what both LiDARs saw, surfaces and empty space alike.

A ray that returned from 20 m says that nothing stood on its way. Points of the other LiDAR that
a wrong transform puts there contradict it, however many others happen to lie on surfaces: a
180 degree turn in a street fits walls and road, and fails here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from percept.calib.lidars.levelling import LevelPlane
from percept.calib.lidars.registration import Surface

__all__ = ["Agreement", "Seen", "agreement", "what_is_seen"]

_F64 = NDArray[np.float64]
_CELL_DEG = 1.0
_NEAR_M = 2.5  # nearer returns are the vehicle's own, which drivers cut out as they like
_MARGIN_M = 0.3
_MARGIN_SHARE = 0.03
_MOST_POINTS = 4000
_ON_PLANE_M = 0.3
_PARALLEL = 0.85


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one LiDAR saw in one scene.

    Attributes:
        surface: Its surfaces.
        nearest_m: (180, 360) nearest range of each direction and its neighbours, inf if none.
        farthest_m: (180, 360) farthest one, 0 where there is none.
        samples: (K, 3) some of the points, to be mapped into the other LiDAR.
        is_structure: (K,) bool, whether a sample stands out of the largest plane: a road fits
            any other road.
    """

    surface: Surface
    nearest_m: _F64
    farthest_m: _F64
    samples: _F64
    is_structure: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Agreement:
    """Counts over points of either LiDAR that the other one must have seen, off the ground.

    Attributes:
        seen: Points in a direction that the other LiDAR looked in, and not behind its returns.
        in_front: Those where the other saw through.
        within_01: Those within 0.1 m of a surface of the other.
        within_05: Those within 0.5 m.
        all_seen: As `seen`, with the largest plane.
        all_01: As `within_01`, with the largest plane.
        all_05: As `within_05`, with the largest plane.
    """

    seen: int = 0
    in_front: int = 0
    within_01: int = 0
    within_05: int = 0
    all_seen: int = 0
    all_01: int = 0
    all_05: int = 0

    def __add__(self, other: Agreement) -> Agreement:
        return Agreement(*(a + b for a, b in zip(_counts(self), _counts(other), strict=True)))

    @property
    def violation(self) -> float:
        """Share of the structure that the other LiDAR saw through."""
        return self.in_front / max(self.seen, 1)

    @property
    def share(self) -> float:
        """Share of the structure within 0.1 m."""
        return self.within_01 / max(self.seen, 1)

    @property
    def sharpness(self) -> float:
        """Of what is within 0.5 m, the share within 0.1 m; chance gives 0.2 to 0.4."""
        return self.within_01 / max(self.within_05, 1)

    @property
    def score(self) -> float:
        """Agreement less contradiction, at most 1."""
        return self.share - self.violation

    @property
    def overlap(self) -> float:
        """Share of everything seen within 0.1 m."""
        return self.all_01 / max(self.all_seen, 1)

    @property
    def overlap_05(self) -> float:
        """Share of everything seen within 0.5 m."""
        return self.all_05 / max(self.all_seen, 1)


def _counts(a: Agreement) -> tuple[int, ...]:
    return (a.seen, a.in_front, a.within_01, a.within_05, a.all_seen, a.all_01, a.all_05)


def what_is_seen(points: _F64, surface: Surface, planes: list[LevelPlane]) -> Seen:
    """Prepare a cloud (N, 3), whose sensor is at the origin, for `agreement`."""
    ranges, rows, columns = _spherical(points)
    shape = (int(180 / _CELL_DEG), int(360 / _CELL_DEG))
    nearest = np.full(shape, np.inf)
    farthest = np.zeros(shape)
    np.minimum.at(nearest, (rows, columns), ranges)
    np.maximum.at(farthest, (rows, columns), ranges)
    mode = ("nearest", "wrap")
    nearest = minimum_filter(nearest, 3, mode=mode)
    farthest = maximum_filter(farthest, 3, mode=mode)
    pick = np.arange(0, len(surface.points), max(1, len(surface.points) // _MOST_POINTS))
    samples = surface.points[pick]
    structure = np.ones(len(pick), dtype=bool)
    if planes:
        up, height = planes[0].normal, planes[0].height_m
        level = surface.is_plane[pick] & (np.abs(surface.normals[pick] @ up) > _PARALLEL)
        structure = ~level & (np.abs(samples @ up + height) > _ON_PLANE_M)
    return Seen(surface, nearest, farthest, samples, structure)


def _spherical(points: _F64) -> tuple[_F64, NDArray[np.int64], NDArray[np.int64]]:
    """Return ranges (N,) and the cell of each direction, rows from z up to z down."""
    ranges = np.linalg.norm(points, axis=1)
    polar = np.degrees(np.arccos(np.clip(points[:, 2] / np.maximum(ranges, 1e-9), -1, 1)))
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0])) + 180.0
    rows = np.minimum((polar / _CELL_DEG).astype(np.int64), int(180 / _CELL_DEG) - 1)
    columns = (azimuth / _CELL_DEG).astype(np.int64) % int(360 / _CELL_DEG)
    return ranges, rows, columns


def agreement(target: Seen, source: Seen, T_target_source: _F64) -> Agreement:
    """Count agreement and contradiction of one scene in both directions."""
    R, t = T_target_source[:3, :3], T_target_source[:3, 3]
    forth = _one_way(target, source.samples @ R.T + t, source)
    back = _one_way(source, (target.samples - t) @ R, target)
    return forth + back


def _one_way(viewer: Seen, points: _F64, other: Seen) -> Agreement:
    """Judge the samples of `other`, in the viewer's frame, against what the viewer saw."""
    ranges, rows, columns = _spherical(points)
    nearest, farthest = viewer.nearest_m[rows, columns], viewer.farthest_m[rows, columns]
    margin = _MARGIN_M + _MARGIN_SHARE * ranges
    far_enough = (ranges > _NEAR_M) & ((other.samples**2).sum(axis=1) > _NEAR_M**2)
    seen = far_enough & (farthest > _NEAR_M) & (ranges < farthest + margin)
    in_front = seen & (ranges < nearest - margin)
    distances = _distances(viewer.surface, points)
    counts = [
        (chosen & ~in_front & (distances < limit)).sum()
        for chosen in (seen & other.is_structure, seen)
        for limit in (0.1, 0.5)
    ]
    structure = other.is_structure
    return Agreement(
        int((seen & structure).sum()),
        int((in_front & structure).sum()),
        int(counts[0]),
        int(counts[1]),
        int(seen.sum()),
        int(counts[2]),
        int(counts[3]),
    )


def _distances(onto: Surface, points: _F64) -> _F64:
    """Return each point's distance (N,) to the nearest surface: to its plane where it has one."""
    gaps, nearest = onto.tree.query(points, distance_upper_bound=0.5)
    distances = np.full(len(points), np.inf)
    hit = np.flatnonzero(np.isfinite(gaps))
    at = nearest[hit]
    off_plane = np.abs(((points[hit] - onto.anchors[at]) * onto.normals[at]).sum(axis=1))
    distances[hit] = np.where(onto.is_plane[at], off_plane, gaps[hit])
    return distances
