"""Numba kernels of `percept.lidar.boxes`: all clusters of a scan in one call.

Everything here works on points in bird's-eye view that are sorted by cluster, so that cluster
``k`` owns ``order[starts[k]:starts[k + 1]]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["fit_all", "group_by_cluster", "share_near_surface"]

# More points do not sharpen the direction of an outline; the extents always use all of them.
_OUTLINE_POINTS = 128
_FINE_STEPS = 4

_I = NDArray[np.int64]
_F = NDArray[np.float64]


@compiled
def group_by_cluster(ids: NDArray[np.int32], count: int) -> tuple[_I, _I]:
    """Sort points by cluster with a counting sort, which keeps their order.

    Args:
        ids: (N,) int32 cluster of each point, -1 for none.
        count: Number of clusters K.

    Returns:
        order: (M,) int64 indices of the points that have a cluster.
        starts: (K + 1,) int64 where each cluster begins in `order`.
    """
    starts = np.zeros(count + 1, np.int64)
    for cluster in ids:
        if cluster >= 0:
            starts[cluster + 1] += 1
    for k in range(count):
        starts[k + 1] += starts[k]
    place = starts[:-1].copy()
    order = np.empty(starts[count], np.int64)
    for i in range(len(ids)):
        cluster = ids[i]
        if cluster >= 0:
            order[place[cluster]] = i
            place[cluster] += 1
    return order, starts


@compiled
def fit_all(
    points: NDArray[np.float32],
    order: _I,
    starts: _I,
    l_shape: bool,  # noqa: FBT001  # numba kernels take no keyword-only arguments
    step_rad: float,
    closest_m: float,
    min_extent_m: float,
) -> _F:
    """Fit one oriented box to each cluster.

    Args:
        points: (N, 3) float32, metres, z up.
        order: (M,) points sorted by cluster.
        starts: (K + 1,) where each cluster begins.
        l_shape: L-shape search, or else the rectangle of least area.
        step_rad: Step of the L-shape search.
        closest_m: Distance below which the L-shape criterion stops to gain.
        min_extent_m: Smallest length, width and height.

    Returns:
        (K, 7) float64 centre x, y, z, length, width, height, yaw.
    """
    count = len(starts) - 1
    boxes = np.empty((count, 7))
    for k in range(count):
        rows = order[starts[k] : starts[k + 1]]
        x, y, origin = _centred(points, rows)
        if l_shape:
            xs, ys = _thinned(x, y)
            angle = _search_l_shape(xs, ys, step_rad, closest_m)
        else:
            angle = _search_min_area(_hull(x, y))
        _write_box(boxes[k], x, y, origin, angle, min_extent_m)
        _write_height(boxes[k], points, rows, min_extent_m)
    return boxes


@compiled
def share_near_surface(
    points: NDArray[np.float32], order: _I, starts: _I, boxes: _F, depth_m: float
) -> _F:
    """Return which share of each cluster lies close behind the two sides that face the origin.

    Args:
        points: (N, 3) float32, metres.
        order: (M,) points sorted by cluster.
        starts: (K + 1,) where each cluster begins.
        boxes: (K, 7) from `fit_all`.
        depth_m: How far behind a side still counts.

    Returns:
        (K,) float64 in 0..1.
    """
    shares = np.empty(len(boxes))
    for k in range(len(boxes)):
        box = boxes[k]
        c, s = np.cos(box[6]), np.sin(box[6])
        toward_u = 1.0 if c * box[0] + s * box[1] < 0.0 else -1.0
        toward_v = 1.0 if c * box[1] - s * box[0] < 0.0 else -1.0
        near = 0
        for i in order[starts[k] : starts[k + 1]]:
            x, y = points[i, 0] - box[0], points[i, 1] - box[1]
            behind_u = 0.5 * box[3] - toward_u * (c * x + s * y)
            behind_v = 0.5 * box[4] - toward_v * (c * y - s * x)
            near += min(behind_u, behind_v) < depth_m
        shares[k] = near / (starts[k + 1] - starts[k])
    return shares


@compiled
def _centred(points: NDArray[np.float32], rows: _I) -> tuple[_F, _F, _F]:
    """Return x and y about the first point, since float sums far from zero lose digits."""
    origin = np.empty(2)
    origin[0], origin[1] = points[rows[0], 0], points[rows[0], 1]
    x, y = np.empty(len(rows)), np.empty(len(rows))
    for i in range(len(rows)):
        x[i] = points[rows[i], 0] - origin[0]
        y[i] = points[rows[i], 1] - origin[1]
    return x, y, origin


@compiled
def _thinned(x: _F, y: _F) -> tuple[_F, _F]:
    n = len(x)
    if n <= _OUTLINE_POINTS:
        return x, y
    xs, ys = np.empty(_OUTLINE_POINTS), np.empty(_OUTLINE_POINTS)
    for i in range(_OUTLINE_POINTS):
        j = i * n // _OUTLINE_POINTS
        xs[i], ys[i] = x[j], y[j]
    return xs, ys


@compiled
def _search_l_shape(x: _F, y: _F, step_rad: float, closest_m: float) -> float:
    """Search the direction in 0..90 deg of the best L (Zhang et al. 2017, algorithm 2)."""
    steps = int(np.ceil(0.5 * np.pi / step_rad))
    best, best_angle = -1.0, 0.0
    for i in range(steps):
        score = _closeness(x, y, i * step_rad, closest_m)
        if score > best:
            best, best_angle = score, i * step_rad
    # All points within `closest_m` of a side count the same, which leaves a plateau of angles.
    sharper_m = 0.5 * closest_m
    coarse, best = best_angle, _closeness(x, y, best_angle, sharper_m)
    for i in range(-_FINE_STEPS + 1, _FINE_STEPS):
        angle = coarse + i * step_rad / _FINE_STEPS
        score = _closeness(x, y, angle, sharper_m)
        if score > best:
            best, best_angle = score, angle
    return best_angle


# Sums in any order: it makes them four times as fast, and the score needs three digits.
@njit(cache=True, fastmath=True)
def _closeness(x: _F, y: _F, angle: float, closest_m: float) -> float:
    """Score how near the points lie to two sides of the rectangle (Zhang 2017, algorithm 4).

    Algorithm 4 picks, per axis, the side with the smaller norm of distances. That is the upper
    side exactly when the mean projection lies above the middle, which needs no second pass.
    """
    c, s = np.cos(angle), np.sin(angle)
    n = len(x)
    low_u = low_v = np.inf
    high_u = high_v = -np.inf
    sum_u = sum_v = 0.0
    for i in range(n):
        u, v = c * x[i] + s * y[i], c * y[i] - s * x[i]
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
        sum_u += u
        sum_v += v
    side_u = high_u if 2.0 * sum_u > n * (low_u + high_u) else low_u
    side_v = high_v if 2.0 * sum_v > n * (low_v + high_v) else low_v
    score = 0.0
    for i in range(n):
        du = abs(c * x[i] + s * y[i] - side_u)
        dv = abs(c * y[i] - s * x[i] - side_v)
        score += 1.0 / max(min(du, dv), closest_m)
    return score


@compiled
def _search_min_area(hull: _F) -> float:
    """Return the direction of the hull edge on which the least rectangle stands.

    One edge of the least rectangle lies on a hull edge (Freeman and Shapira 1975). Hulls of
    clusters have tens of corners, so each edge is simply tried against all of them.
    """
    best_area, best_angle = np.inf, 0.0
    n = len(hull)
    for i in range(n):
        dx = hull[(i + 1) % n, 0] - hull[i, 0]
        dy = hull[(i + 1) % n, 1] - hull[i, 1]
        length = np.hypot(dx, dy)
        if length == 0.0:
            continue
        u = (hull[:, 0] * dx + hull[:, 1] * dy) / length
        v = (hull[:, 1] * dx - hull[:, 0] * dy) / length
        area = (u.max() - u.min()) * (v.max() - v.min())
        if area < best_area:
            best_area, best_angle = area, np.arctan2(dy, dx)
    return best_angle


@compiled
def _hull(x: _F, y: _F) -> _F:
    """Return the corners (H, 2) of the convex hull (Andrew 1979, monotone chain)."""
    n = len(x)
    by_y = np.argsort(y, kind="mergesort")
    rows = by_y[np.argsort(x[by_y], kind="mergesort")]
    hull = np.empty((2 * n + 1, 2))
    size = 0
    for sweep in range(2):
        floor = size + 1
        for step in range(n):
            i = rows[step] if sweep == 0 else rows[n - 1 - step]
            while size > floor and _turn(hull[size - 2], hull[size - 1], x[i], y[i]) <= 0.0:
                size -= 1
            hull[size, 0], hull[size, 1] = x[i], y[i]
            size += 1
        size -= 1
    return hull[: max(size, 1)]


@compiled
def _turn(a: _F, b: _F, x: float, y: float) -> float:
    return float((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]))


@compiled
def _write_box(box: _F, x: _F, y: _F, origin: _F, angle: float, min_extent_m: float) -> None:
    """Write centre, length, width and yaw of the rectangle around all points at an angle."""
    c, s = np.cos(angle), np.sin(angle)
    low_u = low_v = np.inf
    high_u = high_v = -np.inf
    for i in range(len(x)):
        u, v = c * x[i] + s * y[i], c * y[i] - s * x[i]
        low_u, high_u = min(low_u, u), max(high_u, u)
        low_v, high_v = min(low_v, v), max(high_v, v)
    u, v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
    box[0] = c * u - s * v + origin[0]
    box[1] = s * u + c * v + origin[1]
    length, width = high_u - low_u, high_v - low_v
    if width > length:
        length, width, angle = width, length, angle + 0.5 * np.pi
    box[3], box[4] = max(length, min_extent_m), max(width, min_extent_m)
    # Front and rear look alike, so one half turn is enough: (-pi/2, pi/2].
    box[6] = angle - np.pi * np.ceil(angle / np.pi - 0.5)


@compiled
def _write_height(box: _F, points: NDArray[np.float32], rows: _I, min_extent_m: float) -> None:
    low, high = np.inf, -np.inf
    for i in rows:
        low, high = min(low, points[i, 2]), max(high, points[i, 2])
    box[2], box[5] = 0.5 * (low + high), max(high - low, min_extent_m)
