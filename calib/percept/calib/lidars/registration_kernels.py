"""Numba kernels of the registration: local planes, normal equations, correlation of poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["carve_free_space", "correlate_poses", "local_moments", "normal_equations"]

_F64 = NDArray[np.float64]
_Function = TypeVar("_Function", bound=Callable[..., object])


def _compiled(function: _Function) -> _Function:
    """Compile a function at its first call; it runs beside others, without Python's lock."""
    jit = njit(cache=True, error_model="numpy", nogil=True)
    return cast("_Function", jit(function))


@_compiled
def local_moments(points: _F64, neighbours: NDArray[np.int64]) -> tuple[_F64, _F64]:
    """Return the mean (N, 3) and covariance (N, 3, 3) of each point's neighbourhood.

    Args:
        points: (N, 3) metres.
        neighbours: (N, K) indices into `points`.
    """
    count, width = neighbours.shape
    means = np.zeros((count, 3))
    covariances = np.zeros((count, 3, 3))
    for i in range(count):
        for k in range(width):
            means[i] += points[neighbours[i, k]]
        means[i] /= width
        for k in range(width):
            offset = points[neighbours[i, k]] - means[i]
            for a in range(3):
                for b in range(3):
                    covariances[i, a, b] += offset[a] * offset[b] / width
    return means, covariances


@_compiled
def normal_equations(
    arms: _F64,
    offsets: _F64,
    normals: tuple[_F64, _F64],
    blocks: NDArray[np.int64],
    n: int,
    softness: float,
    loose: _F64,
    kernel_m: float,
    angle_rad: float,
    upright: _F64,
) -> tuple[_F64, _F64, _F64, _F64, _F64]:
    """Sum the Gauss-Newton system of generalised ICP, block by block.

    Each point has the covariance of its surface, 1 along it and `softness` across it, so that a
    pair is weighted by ``M = (C_target + R C_source R')^-1`` (Segal et al., "Generalized-ICP",
    RSS 2009, equation 2); M is scaled so that two parallel planes weigh 1 across. With normals
    a and b the eigenvectors of C are a + b, a - b (eigenvalues ``2 - (1 - softness)(1 +- a.b)``)
    and their cross product (2), which gives M without an inversion.

    The unknowns are a small rotation (3, rad) and a shift (3, m), both along the target's axes,
    and by how much the source measures too far (m) and its beams point too high (rad); the
    rotation turns about the source's origin. The kernel is Geman-McClure's, wider and the
    weight lower with range, as the beam and its angular error are.

    Args:
        arms: (N, 3) source points relative to the source's origin, in the target's axes.
        offsets: (N, 3) source point less target point, in the target's axes.
        normals: Unit normals of target and source, each (N, 3), in the target's axes.
        blocks: (N,) which of the `n` sums each pair belongs to.
        n: Number of blocks.
        softness: Variance across a surface over that along it, in (0, 1].
        loose: (N,) weight along the surface: `softness` for generalised ICP, less where the
            surface is flat, because a neighbour there says nothing about the place along it.
        kernel_m: Scale of the kernel: a residual of this size has a quarter of the weight.
        angle_rad: Angular error of a beam.
        upright: (3,) unit z axis of the source, in the target's axes.

    Returns:
        `H` (n, 8, 8), `b` (n, 8), the part `G` (n, 6, 6) of H that comes from the shape of the
        surfaces alone, weighted squares across the surfaces (n,), sums of weights (n,).
    """
    H = np.zeros((n, 8, 8))
    G = np.zeros((n, 6, 6))
    b = np.zeros((n, 8))
    squares = np.zeros(n)
    weights = np.zeros(n)
    u, v, shift = np.empty(3), np.empty(3), np.empty(3)
    faults = np.empty((2, 3))
    shape = np.empty((3, 3))
    metric = np.empty((3, 3))
    for i in range(len(arms)):
        x, r, k = arms[i], offsets[i], blocks[i]
        across, along = _eigenvectors(normals[0][i], normals[1][i], u, v)
        for a in range(3):
            for c in range(3):
                shape[a, c] = (
                    2
                    * softness
                    * (
                        (1 / (2 - (1 - softness) * across) - 0.5) * u[a] * u[c]
                        + (1 / (2 - (1 - softness) * along) - 0.5) * v[a] * v[c]
                    )
                )
                metric[a, c] = shape[a, c]
            metric[a, a] += loose[i]
        cost = 0.0
        for a in range(3):
            shift[a] = metric[a, 0] * r[0] + metric[a, 1] * r[1] + metric[a, 2] * r[2]
            cost += shift[a] * r[a]
        reach = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
        variance = kernel_m * kernel_m + angle_rad * angle_rad * reach
        w = (variance / (variance + cost)) ** 2 * kernel_m * kernel_m / variance
        b[k, 0] += w * (x[1] * shift[2] - x[2] * shift[1])
        b[k, 1] += w * (x[2] * shift[0] - x[0] * shift[2])
        b[k, 2] += w * (x[0] * shift[1] - x[1] * shift[0])
        for a in range(3):
            b[k, 3 + a] += w * shift[a]
        _write_faults(faults, x, np.sqrt(reach), upright)
        for j in range(2):
            b[k, 6 + j] += w * (
                faults[j, 0] * shift[0] + faults[j, 1] * shift[1] + faults[j, 2] * shift[2]
            )
        _add_information(H[k], x, metric, w)
        _add_faults(H[k], x, metric, w, faults)
        _add_information(G[k], x, shape, w)
        residual = u[0] * r[0] + u[1] * r[1] + u[2] * r[2]
        squares[k] += w * residual * residual
        weights[k] += w
    return H, b, G, squares, weights


@_compiled
def _eigenvectors(a: _F64, b: _F64, u: _F64, v: _F64) -> tuple[float, float]:
    """Write the unit sum and difference of two normals; return 1 + |a.b| and 1 - |a.b|."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    sign = 1.0 if cosine >= 0 else -1.0
    cosine = min(abs(cosine), 1.0)
    sums = np.sqrt(2 + 2 * cosine)
    differences = np.sqrt(2 - 2 * cosine)
    for i in range(3):
        u[i] = (a[i] + sign * b[i]) / sums
        v[i] = (a[i] - sign * b[i]) / differences if differences > 1e-6 else 0.0
    return 1 + cosine, 1 - cosine


@_compiled
def _write_faults(faults: _F64, x: _F64, reach: float, upright: _F64) -> None:
    """Write how a point moves (2, 3) when its range is 1 m, and its beam 1 rad, less than said."""
    rise = 0.0
    for a in range(3):
        faults[0, a] = -x[a] / reach
        rise -= faults[0, a] * upright[a]
    flat = np.sqrt(max(1 - rise * rise, 1e-6))
    for a in range(3):
        faults[1, a] = -reach * (upright[a] + rise * faults[0, a]) / flat


@_compiled
def _add_faults(H: _F64, x: _F64, M: _F64, w: float, faults: _F64) -> None:
    """Add the borders of ``w J' M J`` that belong to the columns `faults` (2, 3) to H (8, 8)."""
    pushed = np.empty(3)
    for j in range(2):
        for a in range(3):
            pushed[a] = w * (
                M[a, 0] * faults[j, 0] + M[a, 1] * faults[j, 1] + M[a, 2] * faults[j, 2]
            )
        for i in range(2):
            for a in range(3):
                H[6 + i, 6 + j] += faults[i, a] * pushed[a]
        H[0, 6 + j] += x[1] * pushed[2] - x[2] * pushed[1]
        H[1, 6 + j] += x[2] * pushed[0] - x[0] * pushed[2]
        H[2, 6 + j] += x[0] * pushed[1] - x[1] * pushed[0]
        for a in range(3):
            H[3 + a, 6 + j] += pushed[a]
        for a in range(6):
            H[6 + j, a] = H[a, 6 + j]


@_compiled
def _add_information(H: _F64, x: _F64, M: _F64, w: float) -> None:
    """Add ``w J' M J`` with ``J = [-[x], I]`` to the first rows of a sum (6 or more square)."""
    turned = np.empty((3, 3))  # [x] M
    for c in range(3):
        turned[0, c] = x[1] * M[2, c] - x[2] * M[1, c]
        turned[1, c] = x[2] * M[0, c] - x[0] * M[2, c]
        turned[2, c] = x[0] * M[1, c] - x[1] * M[0, c]
    for a in range(3):
        t = turned[a]
        H[a, 0] += w * (x[1] * t[2] - x[2] * t[1])
        H[a, 1] += w * (x[2] * t[0] - x[0] * t[2])
        H[a, 2] += w * (x[0] * t[1] - x[1] * t[0])
        for c in range(3):
            H[a, 3 + c] += w * t[c]
            H[3 + c, a] += w * t[c]
            H[3 + a, 3 + c] += w * M[a, c]


@_compiled
def carve_free_space(
    grid: NDArray[np.int8], ends: _F64, origin: _F64, corner: _F64, cell_m: float, gap_m: float
) -> None:
    """Mark what the rays of a scan went through as free (-1), and where they ended as occupied.

    Occupied cells are 2, unknown cells next to them 1, both of which free space never overrides.

    Args:
        grid: (X, Y, Z) int8, zeros; written to.
        ends: (N, 3) where the rays ended, in the grid's frame.
        origin: (3,) where they started.
        corner: (3,) corner of the first cell.
        cell_m: Size of a cell.
        gap_m: Rays are followed to this distance before their end.
    """
    size = grid.shape
    for i in range(len(ends)):
        step = ends[i] - origin
        length = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        steps = int((length - gap_m) / (0.5 * cell_m))
        for k in range(steps):
            at = (k + 1) * 0.5 * cell_m / length
            x = int(np.floor((origin[0] + at * step[0] - corner[0]) / cell_m))
            y = int(np.floor((origin[1] + at * step[1] - corner[1]) / cell_m))
            z = int(np.floor((origin[2] + at * step[2] - corner[2]) / cell_m))
            if 0 <= x < size[0] and 0 <= y < size[1] and 0 <= z < size[2]:
                grid[x, y, z] = -1
    for value in (1, 2):
        reach = 2 - value
        for i in range(len(ends)):
            x = int(np.floor((ends[i, 0] - corner[0]) / cell_m))
            y = int(np.floor((ends[i, 1] - corner[1]) / cell_m))
            z = int(np.floor((ends[i, 2] - corner[2]) / cell_m))
            for u in range(max(x - reach, 0), min(x + reach + 1, size[0])):
                for v in range(max(y - reach, 0), min(y + reach + 1, size[1])):
                    for w in range(max(z - reach, 0), min(z + reach + 1, size[2])):
                        grid[u, v, w] = value


@_compiled
def correlate_poses(
    grid: NDArray[np.int8],
    points: _F64,
    corner: _F64,
    cell_m: float,
    yaws: _F64,
    shifts: NDArray[np.int64],
) -> NDArray[np.int32]:
    """Score every yaw and shift: the sum of the cells that the moved points fall into.

    Exhaustive correlative matching (Olson, "Real-time correlative scan matching", ICRA 2009)
    in three dimensions with height fixed.

    Args:
        grid: (X, Y, Z) int8 as `carve_free_space` leaves it.
        points: (N, 3) metres in the source's level frame.
        corner: (3,) corner of the first cell.
        cell_m: Size of a cell.
        yaws: (Y,) rad.
        shifts: (S, 2) in cells along x and y.

    Returns:
        (Y, S) scores.
    """
    scores = np.zeros((len(yaws), len(shifts)), dtype=np.int32)
    size = grid.shape
    for a in range(len(yaws)):
        cosine, sine = np.cos(yaws[a]), np.sin(yaws[a])
        for i in range(len(points)):
            px, py = points[i, 0], points[i, 1]
            x = int(np.floor((cosine * px - sine * py - corner[0]) / cell_m))
            y = int(np.floor((sine * px + cosine * py - corner[1]) / cell_m))
            z = int(np.floor((points[i, 2] - corner[2]) / cell_m))
            if z < 0 or z >= size[2]:
                continue
            for s in range(len(shifts)):
                u = x + shifts[s, 0]
                v = y + shifts[s, 1]
                if 0 <= u < size[0] and 0 <= v < size[1]:
                    scores[a, s] += grid[u, v, z]
    return scores
