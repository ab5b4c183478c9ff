"""The inner loops of the camera renderer, compiled.

Three steps: triangles into a z-buffer of an undistorted view (`rasterise`), what each sample
shows into linear light (`shine`), and samples into the pixels of the distorted image
(`gather`). `undistorted_lattice` inverts the lens for the last one.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "Lighting",
    "gather",
    "light_of",
    "project_clipped",
    "rasterise",
    "shine",
    "undistorted_lattice",
]

_NEWTON_STEPS = 30
_CONVERGED = 1e-12
# Triangles are cut here, in metres before the camera.
_NEAR_M = 0.05
_EDGE_ON = 1e-12


class Lighting(NamedTuple):
    """What the parts of a scene send to the camera, in linear light.

    Attributes:
        faces: (F, 3) float32 of each face.
        zenith: Of the sky overhead.
        horizon: Of the sky at and below the horizon, and of the haze.
        up_cam: The world's up in the optical frame.
        fog_per_m: Extinction of the haze (Koschmieder 1924), 1/m.
    """

    faces: NDArray[np.float32]
    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    up_cam: tuple[float, float, float]
    fog_per_m: float


@njit(cache=True)
def undistorted_lattice(
    width: int, height: int, K: NDArray[np.float64], distortion: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where the corners of all pixels lie without the lens's distortion.

    Brown's polynomial is inverted by Newton's method, because fixed-point iteration stops
    converging where a strong lens bends most.

    Args:
        width: Of the image, pixels.
        height: Of the image, pixels.
        K: (3, 3) camera matrix, pixels.
        distortion: (5,) k1, k2, p1, p2, k3.

    Returns:
        (height + 1, width + 1, 2) normalised x, y of the corners u = column - 0.5,
        v = row - 0.5; NaN where the polynomial has no inverse that grows from the centre.
    """
    lattice = np.empty((height + 1, width + 1, 2))
    for row in range(height + 1):
        y = (row - 0.5 - K[1, 2]) / K[1, 1]
        for column in range(width + 1):
            x = (column - 0.5 - K[0, 2]) / K[0, 0]
            lattice[row, column, 0], lattice[row, column, 1] = _undistort(x, y, distortion)
    return lattice


@njit(cache=True)
def _undistort(xd: float, yd: float, distortion: NDArray[np.float64]) -> tuple[float, float]:
    """Return the normalised point that the lens maps to xd, yd; NaN where there is none."""
    k1, k2, p1, p2, k3 = distortion
    x, y = xd, yd
    for _ in range(_NEWTON_STEPS):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        error_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - xd
        error_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - yd
        slope = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
        jxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        jxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        jyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        determinant = jxx * jyy - jxy * jxy
        if determinant <= 0 or jxx + jyy <= 0:  # past the radius where the image folds back
            break
        if abs(error_x) + abs(error_y) < _CONVERGED:
            return x, y
        x -= (jyy * error_x - jxy * error_y) / determinant
        y -= (jxx * error_y - jxy * error_x) / determinant
    return math.nan, math.nan


@njit(cache=True)
def rasterise(
    vertices_cam: NDArray[np.float64],
    faces: NDArray[np.int32],
    bias: NDArray[np.float64],
    grid: tuple[float, float, float, float],
    inverse_depth: NDArray[np.float32],
    face_at: NDArray[np.int32],
) -> None:
    """Draw triangles into a z-buffer: nearest wins, and depth is perspective-correct.

    The inverse depth of a plane is linear in the image (Blinn 1992, "Hyperbolic
    interpolation"), and is taken from the plane itself rather than from the projected corners,
    so that coplanar triangles agree to rounding and clipping changes nothing.

    Args:
        vertices_cam: (V, 3) in the optical frame, metres.
        faces: (F, 3) vertex indices.
        bias: (F,) factors on the inverse depth, a little over 1 for layers that lie on top.
        grid: fx, fy, cx, cy of the sample grid.
        inverse_depth: (H, W) 1/m, zero where nothing is; updated.
        face_at: (H, W) index of the face that is seen, -1 for none; updated.
    """
    polygon = np.empty((4, 2))
    for face in range(len(faces)):
        corners = project_clipped(vertices_cam, faces[face], grid, polygon)
        if corners < 3:
            continue
        plane = _inverse_depth_plane(vertices_cam, faces[face], grid, bias[face])
        _fill(polygon[:corners], face, plane, inverse_depth, face_at)


@njit(cache=True)
def project_clipped(
    vertices_cam: NDArray[np.float64],
    corners_of_face: NDArray[np.int32],
    grid: tuple[float, float, float, float],
    polygon: NDArray[np.float64],
) -> int:
    """Write the face's image, cut at the near plane, into polygon (4, 2); return its corners."""
    fx, fy, cx, cy = grid
    corners = 0
    for k in range(3):
        i, j = corners_of_face[k], corners_of_face[(k + 1) % 3]
        x, y, z = vertices_cam[i]
        if z >= _NEAR_M:
            polygon[corners, 0] = fx * x / z + cx
            polygon[corners, 1] = fy * y / z + cy
            corners += 1
        if (z >= _NEAR_M) != (vertices_cam[j, 2] >= _NEAR_M):
            # From the lower index to the higher: neighbours cut a shared edge alike.
            x0, y0, z0 = vertices_cam[min(i, j)]
            x1, y1, z1 = vertices_cam[max(i, j)]
            t = (_NEAR_M - z0) / (z1 - z0)
            polygon[corners, 0] = fx * (x0 + t * (x1 - x0)) / _NEAR_M + cx
            polygon[corners, 1] = fy * (y0 + t * (y1 - y0)) / _NEAR_M + cy
            corners += 1
    return corners


@njit(cache=True)
def _inverse_depth_plane(
    vertices_cam: NDArray[np.float64],
    corners_of_face: NDArray[np.int32],
    grid: tuple[float, float, float, float],
    bias: float,
) -> tuple[float, float, float]:
    """Return a, b, c with inverse depth a * column + b * row + c; zeros for a face seen edge-on."""
    fx, fy, cx, cy = grid
    px, py, pz = vertices_cam[corners_of_face[0]]
    ux, uy, uz = vertices_cam[corners_of_face[1]] - vertices_cam[corners_of_face[0]]
    vx, vy, vz = vertices_cam[corners_of_face[2]] - vertices_cam[corners_of_face[0]]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    offset = nx * px + ny * py + nz * pz
    if abs(offset) <= _EDGE_ON * (abs(nx * px) + abs(ny * py) + abs(nz * pz)):
        return 0.0, 0.0, 0.0
    a, b = bias * nx / (offset * fx), bias * ny / (offset * fy)
    return a, b, bias * nz / offset - a * cx - b * cy


@njit(cache=True)
def _fill(
    polygon: NDArray[np.float64],
    face: int,
    plane: tuple[float, float, float],
    inverse_depth: NDArray[np.float32],
    face_at: NDArray[np.int32],
) -> None:
    """Fill a convex polygon row by row."""
    height, width = inverse_depth.shape
    a, b, c = plane
    top, bottom = polygon[:, 1].min(), polygon[:, 1].max()
    for row in range(math.ceil(max(top, 0.0)), math.ceil(min(bottom, float(height)))):
        left, right = _span(polygon, row)
        start = b * row + c
        for column in range(math.ceil(max(left, 0.0)), math.ceil(min(right, float(width)))):
            near = np.float32(start + a * column)
            if near > inverse_depth[row, column]:
                inverse_depth[row, column] = near
                face_at[row, column] = face


@njit(cache=True)
def _span(polygon: NDArray[np.float64], row: int) -> tuple[float, float]:
    """Return where a row enters and leaves a convex polygon; left > right where it does not.

    Ends are half-open and each edge is walked downwards whichever face it belongs to, so that
    neighbours neither leave a gap at their seam nor overlap.
    """
    left, right = math.inf, -math.inf
    for corner in range(len(polygon)):
        x0, y0 = polygon[corner]
        x1, y1 = polygon[(corner + 1) % len(polygon)]
        if y0 > y1:
            x0, y0, x1, y1 = x1, y1, x0, y0
        if y0 <= row < y1:
            x = x0 + (row - y0) * ((x1 - x0) / (y1 - y0))
            left, right = min(left, x), max(right, x)
    return left, right


@njit(cache=True)
def shine(
    face_at: NDArray[np.int32],
    inverse_depth: NDArray[np.float32],
    grid: tuple[float, float, float, float],
    lighting: Lighting,
) -> NDArray[np.float32]:
    """Return the linear light (H, W, 3) of what every sample hits.

    Args:
        face_at: (H, W) face index, -1 for the sky.
        inverse_depth: (H, W) 1/m.
        grid: fx, fy, cx, cy of the sample grid.
        lighting: What faces, sky and haze send out.
    """
    height, width = face_at.shape
    light = np.empty((height, width, 3), np.float32)
    for row in range(height):
        for column in range(width):
            face, near = face_at[row, column], inverse_depth[row, column]
            seen = light_of(face, near, row, column, grid, lighting)
            light[row, column, 0], light[row, column, 1], light[row, column, 2] = seen
    return light


@njit(cache=True)
def light_of(
    face: int,
    near: float,
    row: int,
    column: int,
    grid: tuple[float, float, float, float],
    lighting: Lighting,
) -> tuple[float, float, float]:
    """Return the linear light of a face through the haze, or of the sky where face is -1."""
    low0, low1, low2 = lighting.horizon
    if face >= 0:
        share = 1.0
        if lighting.fog_per_m > 0:
            share = math.exp(-lighting.fog_per_m / near)
        top0, top1, top2 = (
            lighting.faces[face, 0], lighting.faces[face, 1], lighting.faces[face, 2],
        )  # fmt: skip
    else:
        x, y = (column - grid[2]) / grid[0], (row - grid[3]) / grid[1]
        ux, uy, uz = lighting.up_cam
        rise = (ux * x + uy * y + uz) / math.sqrt(x * x + y * y + 1.0)
        share = math.sqrt(max(rise, 0.0))
        top0, top1, top2 = lighting.zenith
    return (
        low0 + share * (top0 - low0),
        low1 + share * (top1 - low1),
        low2 + share * (top2 - low2),
    )


@njit(cache=True)
def gather(
    light: NDArray[np.float32],
    lattice: NDArray[np.float32],
    supersampling: int,
    tone: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Average the samples that fall into each pixel of the distorted image.

    Inside a pixel the undistorted position is interpolated between the pixel's corners, and
    the light between samples: the filter is a box of a pixel with a tent of a sample.

    Args:
        light: (H, W, 3) linear light on the sample grid.
        lattice: (height + 1, width + 1, 2) sample coordinates of the pixels' corners.
        supersampling: Sub-samples along each side of a pixel.
        tone: (T,) picture value of linear light 0..1 in T even steps.

    Returns:
        (height, width, 3) float32 picture values.
    """
    height, width = lattice.shape[0] - 1, lattice.shape[1] - 1
    picture = np.empty((height, width, 3), np.float32)
    steps = np.float32(len(tone) - 1)
    per_step = steps / np.float32(supersampling**2)
    for row in range(height):
        for column in range(width):
            total = (np.float32(0), np.float32(0), np.float32(0))
            for i in range(supersampling):
                down = np.float32((i + 0.5) / supersampling)
                u0, v0 = _between(lattice[row, column], lattice[row + 1, column], down)
                u1, v1 = _between(lattice[row, column + 1], lattice[row + 1, column + 1], down)
                for j in range(supersampling):
                    across = np.float32((j + 0.5) / supersampling)
                    u, v = u0 + across * (u1 - u0), v0 + across * (v1 - v0)
                    total = _add_light(total, light, u, v)
            for k in range(3):
                level = min(max(total[k] * per_step, np.float32(0)), steps)
                picture[row, column, k] = tone[int(level + np.float32(0.5))]
    return picture


@njit(cache=True)
def _between(
    start: NDArray[np.float32], end: NDArray[np.float32], share: np.float32
) -> tuple[np.float32, np.float32]:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


@njit(cache=True)
def _add_light(
    total: tuple[np.float32, np.float32, np.float32],
    light: NDArray[np.float32],
    u: np.float32,
    v: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:
    """Return the total and the light at column u, row v, interpolated between four samples."""
    column, row = int(u), int(v)
    s, t = u - np.float32(column), v - np.float32(row)
    w11 = s * t
    w10, w01 = t - w11, s - w11
    w00 = np.float32(1) - s - w10
    a, b = light[row, column], light[row, column + 1]
    c, d = light[row + 1, column], light[row + 1, column + 1]
    return (
        total[0] + w00 * a[0] + w01 * b[0] + w10 * c[0] + w11 * d[0],
        total[1] + w00 * a[1] + w01 * b[1] + w10 * c[1] + w11 * d[1],
        total[2] + w00 * a[2] + w01 * b[2] + w10 * c[2] + w11 * d[2],
    )
