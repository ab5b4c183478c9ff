"""Compiled search for planes of about a plate's size, and for the rays that meet them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["HIT", "NEARER", "PASSED", "classify_rays", "grow_planes", "score_windows"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]
_Grid = tuple[_I64, _I64, float, _I64, _I64]

HIT, PASSED, NEARER = 1, 2, 3

_DRAWS = 40
_DRAWN_FROM = 96  # points of a ball that hypotheses are drawn from and counted on
_FEWEST_IN_BALL = 8
_SMALLEST_SHARE = 50  # per cent of a ball that must lie on its plane
_NARROWEST = 0.15  # of a ball's radius: rms width of a plane's points
_STEPS = 5
_STILL = 0.02  # of the reach: a smaller move ends the growth
_LARGEST_CLAIM = 3  # a point starts no search any more once it lay on so many planes


@compiled
def _cell_rows(grid: _Grid, ix: int, iy: int, iz: int) -> tuple[int, int]:
    """Return the first and the end row of a cell's points in the sorted order."""
    keys, starts, _, low, size = grid
    if ix < low[0] or iy < low[1] or iz < low[2]:
        return 0, 0
    x, y, z = ix - low[0], iy - low[1], iz - low[2]
    if x >= size[0] or y >= size[1] or z >= size[2]:
        return 0, 0
    key = (x * size[1] + y) * size[2] + z
    k = np.searchsorted(keys, key)
    if k >= len(keys) or keys[k] != key:
        return 0, 0
    return starts[k], starts[k + 1]


@compiled
def _ball(points: _F64, grid: _Grid, c: _F64, radius: float, out: _I64) -> int:
    """Collect the rows of the points within a radius of c; returns how many."""
    edge = grid[2]
    count = 0
    lowest = np.floor((c - radius) / edge).astype(np.int64)
    highest = np.floor((c + radius) / edge).astype(np.int64)
    for ix in range(lowest[0], highest[0] + 1):
        for iy in range(lowest[1], highest[1] + 1):
            for iz in range(lowest[2], highest[2] + 1):
                first, end = _cell_rows(grid, ix, iy, iz)
                for k in range(first, end):
                    x, y, z = points[k, 0] - c[0], points[k, 1] - c[1], points[k, 2] - c[2]
                    if x * x + y * y + z * z <= radius * radius:
                        out[count] = k
                        count += 1
    return count


@compiled
def _fit_plane(points: _F64, rows: _I64, count: int) -> tuple[_F64, _F64, _F64]:
    """Return the mean, the eigenvalues (ascending) and the eigenvectors of some points."""
    mean = np.zeros(3)
    for k in range(count):
        mean += points[rows[k]]
    mean /= count
    scatter = np.zeros((3, 3))
    for k in range(count):
        x, y, z = points[rows[k]] - mean
        scatter[0, 0] += x * x
        scatter[0, 1] += x * y
        scatter[0, 2] += x * z
        scatter[1, 1] += y * y
        scatter[1, 2] += y * z
        scatter[2, 2] += z * z
    scatter[1, 0], scatter[2, 0], scatter[2, 1] = scatter[0, 1], scatter[0, 2], scatter[1, 2]
    values, vectors = np.linalg.eigh(scatter / count)
    return mean, values, vectors


@compiled
def _keep_near_plane(
    points: _F64, rows: _I64, count: int, normal: _F64, offset: float, tolerance: float
) -> int:
    """Move the rows of the points near the plane to the front; returns how many."""
    kept = 0
    for k in range(count):
        p = points[rows[k]]
        if abs(p[0] * normal[0] + p[1] * normal[1] + p[2] * normal[2] - offset) < tolerance:
            rows[k], rows[kept] = rows[kept], rows[k]
            kept += 1
    return kept


@compiled
def _draw_plane(
    points: _F64, rows: _I64, count: int, tolerance: float, state: np.uint64
) -> tuple[_F64, float, int]:
    """RANSAC on the points of a ball: normal, offset and inliers in per cent of those counted."""
    step = max(count // _DRAWN_FROM, 1)
    n = count // step
    best, normal, offset = 0, np.zeros(3), 0.0
    for _ in range(_DRAWS):
        drawn = np.empty((3, 3))
        for k in range(3):
            state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
            drawn[k] = points[rows[int((state >> np.uint64(33)) % np.uint64(n)) * step]]
        across = np.cross(drawn[1] - drawn[0], drawn[2] - drawn[0])
        length = math.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
        if length < 1e-9:
            continue
        across /= length
        at = across[0] * drawn[0, 0] + across[1] * drawn[0, 1] + across[2] * drawn[0, 2]
        inliers = 0
        for k in range(n):
            p = points[rows[k * step]]
            inliers += abs(p[0] * across[0] + p[1] * across[1] + p[2] * across[2] - at) < tolerance
        if inliers > best:
            best, normal, offset = inliers, across, at
    return normal, offset, best * 100 // n


@compiled
def grow_planes(
    points: _F64, grid: _Grid, seeds: _I64, ball_m: float, reach_m: float, tolerance_m: float
) -> _F64:
    """Grow a plane from every seed that no large plane has claimed yet.

    A plane starts as the majority of a ball that fits on the plate, takes the points near it
    within the plate's reach, and moves to their middle, as mean shift does.

    Args:
        points: (N, 3) sorted by cell.
        grid: Cells' keys, first rows, edge in metres, lowest cell, cells along x, y, z.
        seeds: (S,) rows of points.
        ball_m: Radius of the first ball.
        reach_m: Radius of what belongs to one plate.
        tolerance_m: Largest distance from the plane.

    Returns:
        (C, 8) middle (3), normal (3), number of points, rms distance from the middle.
    """
    claims = np.zeros(len(points), np.int8)
    rows = np.empty(len(points), np.int64)
    found = np.empty((len(seeds), 8))
    planes = 0
    for seed in seeds:
        if claims[seed] >= _LARGEST_CLAIM:
            continue
        ok, mean, normal = _start_plane(points, grid, seed, ball_m, tolerance_m, rows)
        if not ok:
            continue
        count, mean, normal, spread = _grow(points, grid, mean, normal, reach_m, tolerance_m, rows)
        if count < _FEWEST_IN_BALL:
            continue
        for k in range(count):
            if claims[rows[k]] < _LARGEST_CLAIM:
                claims[rows[k]] += 1
        found[planes, :3] = mean
        found[planes, 3:6] = normal
        found[planes, 6] = count
        found[planes, 7] = spread
        planes += 1
    return found[:planes]


@compiled
def _start_plane(
    points: _F64, grid: _Grid, seed: int, ball_m: float, tolerance_m: float, rows: _I64
) -> tuple[bool, _F64, _F64]:
    """Return whether a seed's ball is mostly one plane, a point on it and its normal."""
    count = _ball(points, grid, points[seed], ball_m, rows)
    if count < _FEWEST_IN_BALL:
        return False, np.zeros(3), np.zeros(3)
    # Drawn with half the tolerance: a plate close before a wall would give a plane across both.
    tight = tolerance_m / 2
    normal, offset, share = _draw_plane(points, rows, count, tight, np.uint64(seed))
    if share < _SMALLEST_SHARE:
        return False, np.zeros(3), np.zeros(3)
    count = _keep_near_plane(points, rows, count, normal, offset, tight)
    mean, values, vectors = _fit_plane(points, rows, count)
    is_wide = values[1] > (_NARROWEST * ball_m) ** 2  # one scan line has no plane
    return is_wide, mean, np.ascontiguousarray(vectors[:, 0])


@compiled
def _grow(
    points: _F64,
    grid: _Grid,
    mean: _F64,
    normal: _F64,
    reach_m: float,
    tolerance_m: float,
    rows: _I64,
) -> tuple[int, _F64, _F64, float]:
    """Gather a plane's points within reach and move to their middle until that stands still.

    Returns:
        How many points, whose rows come first; their middle, normal, and rms distance from
        the middle.
    """
    count, spread = 0, 0.0
    for _ in range(_STEPS):
        offset = normal[0] * mean[0] + normal[1] * mean[1] + normal[2] * mean[2]
        count = _ball(points, grid, mean, reach_m, rows)
        count = _keep_near_plane(points, rows, count, normal, offset, tolerance_m)
        if count < _FEWEST_IN_BALL:
            break
        before = mean
        mean, values, vectors = _fit_plane(points, rows, count)
        normal = np.ascontiguousarray(vectors[:, 0])
        spread = math.sqrt(values[1] + values[2])
        if np.abs(mean - before).max() < _STILL * reach_m:
            break
    return count, mean, normal, spread


@compiled
def classify_rays(
    points: _F64, middle: _F64, axes: _F64, radius_m: float, tolerance_m: float
) -> tuple[_F64, _I64, _I64]:
    """Find where the rays of a cloud cross a plane, and what they did there.

    The direction of a ray is known far better than its range, so the crossing is where the
    beam met the plane, whatever it hit.

    Args:
        points: (N, 3) returns in the sensor's frame, the sensor at its origin.
        middle: (3,) a point on the plane.
        axes: (3, 3) columns x, y in the plane and its normal.
        radius_m: Crossings farther from the middle are left out.
        tolerance_m: Returns within this distance of the plane are hits.

    Returns:
        (K, 3) crossings along x and y from the middle and distance from the plane, metres;
        (K,) `HIT`, `PASSED` (the return lies behind the plane) or `NEARER`; (K,) rows.
    """
    n = axes[:, 2]
    offset = n[0] * middle[0] + n[1] * middle[1] + n[2] * middle[2]
    far = math.sqrt(middle[0] ** 2 + middle[1] ** 2 + middle[2] ** 2)
    cone = math.cos(min(math.asin(min(radius_m / far, 1.0)), 1.5))
    crossings = np.empty((len(points), 3))
    kinds = np.empty(len(points), np.int64)
    rows = np.empty(len(points), np.int64)
    count = 0
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        along = x * middle[0] + y * middle[1] + z * middle[2]
        if along <= 0.0 or along < cone * far * math.sqrt(x * x + y * y + z * z):
            continue
        depth = x * n[0] + y * n[1] + z * n[2]
        if depth * offset <= 0.0:
            continue
        t = offset / depth
        qx, qy, qz = x * t - middle[0], y * t - middle[1], z * t - middle[2]
        u = qx * axes[0, 0] + qy * axes[1, 0] + qz * axes[2, 0]
        v = qx * axes[0, 1] + qy * axes[1, 1] + qz * axes[2, 1]
        if u * u + v * v > radius_m * radius_m:
            continue
        crossings[count, 0], crossings[count, 1] = u, v
        crossings[count, 2] = depth - offset
        if abs(depth - offset) < tolerance_m:
            kinds[count] = HIT
        else:
            kinds[count] = PASSED if t < 1.0 else NEARER
        rows[count] = i
        count += 1
    return crossings[:count], kinds[:count], rows[:count]


@compiled
def score_windows(
    crossings: _F64,
    kinds: _I64,
    angles: _F64,
    size: tuple[float, float],
    margin: float,
    bin_m: float,
    half: int,
) -> _F64:
    """Slide a rectangle over the crossings, at several angles, and keep the best.

    A window gains its hits and loses the rays that passed through it and the hits that lie
    within a margin around it.

    Args:
        crossings: (K, 2 or more) metres in the plane.
        kinds: (K,) kinds of the rays.
        angles: (A,) rad of the rectangle's x axis.
        size: Its sides, metres.
        margin: Width of the band around it, metres.
        bin_m: Step of the search.
        half: Bins from the middle to the border of the search.

    Returns:
        (4,) score, angle, and middle x, y in the rectangle's turned axes.
    """
    n = 2 * half + 1
    best = np.array([-np.inf, 0.0, 0.0, 0.0])
    inner = (max(round(size[0] / bin_m), 1), max(round(size[1] / bin_m), 1))
    m = max(round(margin / bin_m), 1)
    for angle in angles:
        c, s = math.cos(angle), math.sin(angle)
        hits = np.zeros((n + 1, n + 1), np.int64)
        passed = np.zeros((n + 1, n + 1), np.int64)
        for k in range(len(crossings)):
            i = math.floor((c * crossings[k, 0] + s * crossings[k, 1]) / bin_m) + half
            j = math.floor((c * crossings[k, 1] - s * crossings[k, 0]) / bin_m) + half
            if 0 <= i < n and 0 <= j < n:
                if kinds[k] == HIT:
                    hits[i + 1, j + 1] += 1
                elif kinds[k] == PASSED:
                    passed[i + 1, j + 1] += 1
        _integrate(hits)
        _integrate(passed)
        for i in range(n + 1 - inner[0]):
            for j in range(n + 1 - inner[1]):
                on = _window(hits, i, j, i + inner[0], j + inner[1])
                through = _window(passed, i, j, i + inner[0], j + inner[1])
                around = _window(
                    hits,
                    max(i - m, 0),
                    max(j - m, 0),
                    min(i + inner[0] + m, n),
                    min(j + inner[1] + m, n),
                )
                score = 2.0 * on - through - around
                if score > best[0]:
                    best[0], best[1] = score, angle
                    best[2] = (i - half) * bin_m + size[0] / 2
                    best[3] = (j - half) * bin_m + size[1] / 2
    return best


@compiled
def _integrate(table: _I64) -> None:
    """Turn counts into sums over everything before, in place."""
    for i in range(1, table.shape[0]):
        for j in range(1, table.shape[1]):
            table[i, j] += table[i - 1, j] + table[i, j - 1] - table[i - 1, j - 1]


@compiled
def _window(table: _I64, i0: int, j0: int, i1: int, j1: int) -> int:
    return int(table[i1, j1] - table[i0, j1] - table[i1, j0] + table[i0, j0])
