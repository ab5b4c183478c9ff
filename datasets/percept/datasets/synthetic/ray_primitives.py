"""Where a ray meets a primitive or the ground, in closed form (numba kernels).

Every function takes a ray origin and unit direction in the frame of the surface and returns
the distance along the ray, infinity where there is none, and the cosine of the angle of
incidence. A ray that starts inside a solid does not meet it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.datasets.synthetic.terrain import (
    KERB_HEIGHT_M,
    KNOT_SPACING_M,
    ROAD_HALF_WIDTH_M,
)

__all__ = ["KERB", "ROAD", "SIDEWALK", "hit_ground", "hit_primitive", "profile_height"]

ROAD, KERB, SIDEWALK = 0, 1, 2
_SLACK_M = 1e-9


@njit(cache=True, error_model="numpy")
def hit_primitive(
    row: NDArray[np.float64],
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
) -> tuple[float, float]:
    """Meet a packed primitive; the ray is in the frame of its object."""
    px, py, pz = ox - row[10], oy - row[11], oz - row[12]
    ax = row[1] * px + row[2] * py + row[3] * pz
    ay = row[4] * px + row[5] * py + row[6] * pz
    az = row[7] * px + row[8] * py + row[9] * pz
    bx = row[1] * dx + row[2] * dy + row[3] * dz
    by = row[4] * dx + row[5] * dy + row[6] * dz
    bz = row[7] * dx + row[8] * dy + row[9] * dz
    if row[0] == 0.0:
        return _hit_box(ax, ay, az, bx, by, bz, row[13], row[14], row[15])
    if row[0] == 1.0:
        return _hit_frustum(ax, ay, az, bx, by, bz, row[13], row[14], row[15])
    return _hit_ellipsoid(ax, ay, az, bx, by, bz, row[13], row[14], row[15])


@njit(cache=True, error_model="numpy")
def _hit_box(
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    hx: float,
    hy: float,
    hz: float,
) -> tuple[float, float]:
    """Kay and Kajiya's slabs: the last entry must lie before the first exit."""
    enter, leave, cosine = -math.inf, math.inf, 0.0
    for o, d, h in ((ox, dx, hx), (oy, dy, hy), (oz, dz, hz)):
        if d == 0.0:
            if abs(o) > h:
                return math.inf, 0.0
            continue
        near, far = (-h - o) / d, (h - o) / d
        if near > far:
            near, far = far, near
        if near > enter:
            enter, cosine = near, abs(d)
        leave = min(leave, far)
    if enter > leave or enter <= 0.0:
        return math.inf, 0.0
    return enter, cosine


@njit(cache=True, error_model="numpy")
def _hit_ellipsoid(
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    sx: float,
    sy: float,
    sz: float,
) -> tuple[float, float]:
    """Scale to the unit sphere, where the distance along the ray stays the same."""
    ux, uy, uz = ox / sx, oy / sy, oz / sz
    vx, vy, vz = dx / sx, dy / sy, dz / sz
    a = vx * vx + vy * vy + vz * vz
    b = ux * vx + uy * vy + uz * vz
    disc = b * b - a * (ux * ux + uy * uy + uz * uz - 1.0)
    if disc <= 0.0:
        return math.inf, 0.0
    t = (-b - math.sqrt(disc)) / a
    if t <= 0.0:
        return math.inf, 0.0
    nx, ny, nz = (ux + t * vx) / sx, (uy + t * vy) / sy, (uz + t * vz) / sz
    cosine = abs(nx * dx + ny * dy + nz * dz) / math.sqrt(nx * nx + ny * ny + nz * nz)
    return t, cosine


@njit(cache=True, error_model="numpy")
def _hit_frustum(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, r0: float, r1: float, h: float
) -> tuple[float, float]:
    """Meet the mantle x^2 + y^2 = (m + k z)^2 between the two caps, and the caps."""
    k, m = (r1 - r0) / (2.0 * h), (r0 + r1) / 2.0
    best, cosine = math.inf, 0.0
    at_origin = m + k * oz
    a = dx * dx + dy * dy - k * k * dz * dz
    b = ox * dx + oy * dy - k * dz * at_origin
    c = ox * ox + oy * oy - at_origin * at_origin
    inside = c < 0.0 and abs(oz) < h
    disc = b * b - a * c
    if inside:
        return best, cosine
    if disc > 0.0 and a != 0.0:
        root = math.sqrt(disc)
        for t in ((-b - root) / a, (-b + root) / a):
            z = oz + t * dz
            if 0.0 < t < best and abs(z) <= h and m + k * z >= 0.0:
                x, y, s = ox + t * dx, oy + t * dy, -k * (m + k * z)
                best = t
                cosine = abs(x * dx + y * dy + s * dz) / math.sqrt(x * x + y * y + s * s)
    if dz != 0.0:
        for end, radius in ((-h, r0), (h, r1)):
            t = (end - oz) / dz
            x, y = ox + t * dx, oy + t * dy
            if 0.0 < t < best and x * x + y * y <= radius * radius:
                best, cosine = t, abs(dz)
    return best, cosine


@njit(cache=True, error_model="numpy")
def profile_height(heights: NDArray[np.float64], x: float) -> float:
    """Return the road's height, as `Profile.height` does."""
    place = x / KNOT_SPACING_M
    index = math.floor(place)
    before = heights[index % len(heights)]
    height: float = before + (heights[(index + 1) % len(heights)] - before) * (place - index)
    return height


@njit(cache=True, error_model="numpy")
def hit_ground(
    heights: NDArray[np.float64],
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
) -> tuple[float, float, int]:
    """Meet road, kerbs or sidewalks nearer than a limit: distance, cosine, surface."""
    best, cosine, surface = _hit_kerbs(heights, ox, oy, oz, dx, dy, dz, limit)
    index = math.floor(ox / KNOT_SPACING_M)
    step = 1 if dx > 0.0 else -1
    enter = 0.0
    while enter < best:
        edge = (index + (1 if step > 0 else 0)) * KNOT_SPACING_M
        leave = (edge - ox) / dx if dx != 0.0 else math.inf
        before = heights[index % len(heights)]
        grade = (heights[(index + 1) % len(heights)] - before) / KNOT_SPACING_M
        above = oz - before - grade * (ox - index * KNOT_SPACING_M)
        sinking = grade * dx - dz
        for top in range(2):
            t = (above - top * KERB_HEIGHT_M) / sinking
            if sinking > 0.0 and enter - _SLACK_M <= t <= leave + _SLACK_M and 0.0 < t < best:
                beyond = abs(oy + t * dy) > ROAD_HALF_WIDTH_M
                if beyond == (top == 1):
                    best, surface = t, SIDEWALK if top == 1 else ROAD
                    cosine = sinking / math.sqrt(1.0 + grade * grade)
        enter = leave
        index += step
    return best if surface >= 0 else math.inf, cosine, surface


@njit(cache=True, error_model="numpy")
def _hit_kerbs(
    heights: NDArray[np.float64],
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
) -> tuple[float, float, int]:
    best, cosine, surface = limit, 0.0, -1
    if dy == 0.0:
        return best, cosine, surface
    for side in (-1.0, 1.0):
        t = (side * ROAD_HALF_WIDTH_M - oy) / dy
        if 0.0 < t < best:
            over = oz + t * dz - profile_height(heights, ox + t * dx)
            if 0.0 <= over <= KERB_HEIGHT_M:
                best, cosine, surface = t, abs(dy), KERB
    return best, cosine, surface
