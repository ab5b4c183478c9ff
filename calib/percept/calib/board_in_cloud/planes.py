"""Planes of about a plate's size in a cloud, grown from seeds wherever they may be.

No clusters are cut: a plate that touches the floor, a wall or the person who holds it is one
cluster with them, but a ball smaller than the plate still finds its plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

__all__ = ["PlaneCandidate", "grow_plane_candidates"]

_BALL_PER_SIDE = 0.45  # a ball at the middle of the plate then holds nothing but plate
_REACH_PER_DIAGONAL = 0.75
_VOXELS_PER_SIDE = 25  # thinning: a plate keeps hundreds of points however dense the cloud is
_SEEDS_PER_BALL = 1.5
_SAME_PLACE_PER_DIAGONAL = 0.25
_SAME_NORMAL = 0.9


@dataclass(frozen=True, slots=True, eq=False)
class PlaneCandidate:
    """A plane and the points around its middle.

    Attributes:
        middle: (3,) mean of its points, metres in the LiDAR's frame.
        normal: (3,) unit normal towards the sensor.
        points: How many points of the thinned cloud lie on it, within a plate's reach.
        spread: Their rms distance from the middle over what a full plate has.
    """

    middle: NDArray[np.float64]
    normal: NDArray[np.float64]
    points: int
    spread: float


def grow_plane_candidates(
    points: NDArray[np.float64],
    may_start: NDArray[np.bool_],
    plate_size_m: tuple[float, float],
    tolerance_m: float,
) -> list[PlaneCandidate]:
    """Find planes that hold a ball of the plate's size, each once, those of most points first.

    Args:
        points: (N, 3) finite, in the LiDAR's frame.
        may_start: (N,) points that a plane may be grown from; all points may belong to it.
        plate_size_m: Width and height of the plate.
        tolerance_m: Largest distance of a point from its plane.
    """
    from percept.calib.board_in_cloud.kernels import grow_planes

    shorter, diagonal = min(plate_size_m), float(np.hypot(*plate_size_m))
    ball = _BALL_PER_SIDE * shorter
    thin = _first_in_voxel(points, shorter / _VOXELS_PER_SIDE)
    order, grid = _sort_into_cells(points[thin], ball)
    thinned, starts = points[thin][order], may_start[thin][order]
    candidates = np.flatnonzero(starts)
    seeds = candidates[_first_in_voxel(thinned[candidates], ball / _SEEDS_PER_BALL)]
    reach = _REACH_PER_DIAGONAL * diagonal
    found = grow_planes(thinned, grid, seeds, ball, reach, tolerance_m)
    full = diagonal / np.sqrt(12.0)
    return _without_repeats(found, full, _SAME_PLACE_PER_DIAGONAL * diagonal, tolerance_m)


def _first_in_voxel(points: NDArray[np.float64], edge_m: float) -> NDArray[np.int64]:
    """Return the row of the first point of each voxel, in order."""
    if not len(points):
        return np.zeros(0, np.int64)
    keys = _voxel_keys(points, edge_m)[0]
    return np.sort(np.unique(keys, return_index=True)[1])


def _voxel_keys(
    points: NDArray[np.float64], edge_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return each point's voxel as one number, the lowest voxel and the voxels along x, y, z."""
    cells = np.floor(points / edge_m).astype(np.int64)
    low = cells.min(axis=0)
    size = cells.max(axis=0) - low + 1
    cells -= low
    return (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2], low, size


def _sort_into_cells(
    points: NDArray[np.float64], edge_m: float
) -> tuple[
    NDArray[np.int64],
    tuple[NDArray[np.int64], NDArray[np.int64], float, NDArray[np.int64], NDArray[np.int64]],
]:
    """Return the points' order by cell, and the cells as the kernels look them up."""
    keys, low, size = _voxel_keys(points, edge_m)
    order = np.argsort(keys, kind="stable")
    cells, starts = np.unique(keys[order], return_index=True)
    return order, (cells, np.append(starts, len(points)).astype(np.int64), edge_m, low, size)


def _without_repeats(
    found: NDArray[np.float64], full_spread_m: float, same_m: float, same_depth_m: float
) -> list[PlaneCandidate]:
    if not len(found):
        return []
    rows = found[np.argsort(-found[:, 6], kind="stable")]
    middles, normals = rows[:, :3], rows[:, 3:6]
    normals = np.where((np.einsum("ij,ij->i", normals, middles) > 0)[:, None], -normals, normals)
    fresh = np.ones(len(rows), np.bool_)
    for k, near in enumerate(cKDTree(middles).query_ball_point(middles, same_m)):
        if fresh[k]:
            later = np.array([j for j in near if j > k], dtype=np.int64)
            same = normals[later] @ normals[k] > _SAME_NORMAL
            same &= np.abs((middles[later] - middles[k]) @ normals[k]) < same_depth_m
            fresh[later[same]] = False
    return [
        PlaneCandidate(middles[k], normals[k], int(rows[k, 6]), float(rows[k, 7]) / full_spread_m)
        for k in np.flatnonzero(fresh)
    ]
