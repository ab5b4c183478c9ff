"""Casts the rays of a spinning LiDAR into a snapshot of the world (numba kernels).

All beams of one column leave at one time and lie in one plane through the spin axis, so the
objects that a column can meet are found once: those whose bounding sphere touches the plane.

Numba keeps compiled kernels by the time of this file alone: after a change to `ray_primitives`
or to a constant of `terrain`, touch this file too.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.datasets.synthetic.ray_primitives import (
    KERB,
    ROAD,
    hit_ground,
    hit_primitive,
    profile_height,
)
from percept.datasets.synthetic.terrain import SIDEWALK_EDGE_M

__all__ = ["GROUND", "NOTHING", "cast_columns"]

GROUND, NOTHING = -1, -2

_ASPHALT, _CONCRETE, _GRASS = 0.14, 0.38, 0.45


@njit(cache=True, error_model="numpy")
def cast_columns(
    azimuths: NDArray[np.float64],
    elevations: NDArray[np.float64],
    T_map_sensor: NDArray[np.float64],
    times_s: NDArray[np.float64],
    heights: NDArray[np.float64],
    objects: NDArray[np.float64],
    first: NDArray[np.int64],
    primitives: NDArray[np.float64],
    lines: NDArray[np.float64],
    bars: NDArray[np.float64],
    max_range_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Cast every beam of every column.

    Args:
        azimuths: (C,) rad of the columns in the sensor's frame.
        elevations: (B,) rad of the beams.
        T_map_sensor: (C, 4, 4) exact pose at the time of each column.
        times_s: (C,) seconds since the start of the drive.
        heights: (K,) knots of the road's profile.
        objects: (M, 10) packed objects: x, y, height over the road, cos and sin of the yaw,
            speed along x, middle of the bounding sphere (3) in its own frame, radius.
        first: (M + 1,) index of the first primitive of each object.
        primitives: (P, 18) packed primitives.
        lines: (L, 6) y, half width, period, dash, reflectance, retro gain.
        bars: (S, 6) x0, x1, y0, y1, reflectance, retro gain.
        max_range_m: Returns beyond are none.

    Returns:
        (C, B, 4) float64 range, cosine of incidence, reflectance and retro gain, the range
        NaN without a return; and (C, B) int32 index of the object, `GROUND` or `NOTHING`.
    """
    hits = np.empty((len(azimuths), len(elevations), 4))
    what = np.empty((len(azimuths), len(elevations)), np.int32)
    near = np.empty((len(objects), 6))
    which = np.empty(len(objects), np.int32)
    for c in range(len(azimuths)):
        pose = T_map_sensor[c]
        count = _gather(azimuths[c], pose, times_s[c], heights, objects, near, which)
        ca, sa = math.cos(azimuths[c]), math.sin(azimuths[c])
        for b in range(len(elevations)):
            ce, se = math.cos(elevations[b]), math.sin(elevations[b])
            ux, uy = ce * ca, ce * sa
            dx = pose[0, 0] * ux + pose[0, 1] * uy + pose[0, 2] * se
            dy = pose[1, 0] * ux + pose[1, 1] * uy + pose[1, 2] * se
            dz = pose[2, 0] * ux + pose[2, 1] * uy + pose[2, 2] * se
            hit = hits[c, b]
            hit[0] = max_range_m
            what[c, b] = _nearest_object(
                dx, dy, dz, count, near, which, objects, first, primitives, hit
            )
            t, cosine, surface = hit_ground(
                heights, pose[0, 3], pose[1, 3], pose[2, 3], dx, dy, dz, hit[0]
            )
            if t < hit[0]:
                what[c, b] = GROUND
                hit[0], hit[1] = t, cosine
                _ground_material(
                    pose[0, 3] + t * dx, pose[1, 3] + t * dy, surface, lines, bars, hit
                )
            if what[c, b] == NOTHING:
                hit[:] = math.nan
    return hits, what


@njit(cache=True, error_model="numpy")
def _gather(
    azimuth: float,
    pose: NDArray[np.float64],
    time_s: float,
    heights: NDArray[np.float64],
    objects: NDArray[np.float64],
    near: NDArray[np.float64],
    which: NDArray[np.int32],
) -> int:
    """Note the objects that the column's half plane can touch, relative to the sensor.

    A row of `near` is the middle of the bounding sphere (3) and the origin of the object's
    frame (3), both from the sensor in the map's axes.
    """
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    count = 0
    for i in range(len(objects)):
        o = objects[i]
        x = o[0] + o[5] * time_s
        px, py = x - pose[0, 3], o[1] - pose[1, 3]
        pz = profile_height(heights, x) + o[2] - pose[2, 3]
        mx = px + o[3] * o[6] - o[4] * o[7]
        my = py + o[4] * o[6] + o[3] * o[7]
        mz = pz + o[8]
        sx = pose[0, 0] * mx + pose[1, 0] * my + pose[2, 0] * mz
        sy = pose[0, 1] * mx + pose[1, 1] * my + pose[2, 1] * mz
        if abs(ca * sy - sa * sx) <= o[9] and ca * sx + sa * sy >= -o[9]:
            row = near[count]
            row[0], row[1], row[2] = mx, my, mz
            row[3], row[4], row[5] = px, py, pz
            which[count] = i
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def _nearest_object(
    dx: float,
    dy: float,
    dz: float,
    count: int,
    near: NDArray[np.float64],
    which: NDArray[np.int32],
    objects: NDArray[np.float64],
    first: NDArray[np.int64],
    primitives: NDArray[np.float64],
    hit: NDArray[np.float64],
) -> int:
    """Return the nearest object that a ray meets before `hit[0]`; fill `hit` from it."""
    found = NOTHING
    for n in range(count):
        row, i = near[n], which[n]
        along = dx * row[0] + dy * row[1] + dz * row[2]
        radius = objects[i, 9]
        apart = row[0] * row[0] + row[1] * row[1] + row[2] * row[2] - along * along
        if apart > radius * radius or along + radius < 0.0 or along - radius > hit[0]:
            continue
        cos, sin = objects[i, 3], objects[i, 4]
        ox, oy, oz = -(cos * row[3] + sin * row[4]), sin * row[3] - cos * row[4], -row[5]
        lx, ly = cos * dx + sin * dy, cos * dy - sin * dx
        for p in range(first[i], first[i + 1]):
            t, cosine = hit_primitive(primitives[p], ox, oy, oz, lx, ly, dz)
            if t < hit[0]:
                found = i
                hit[0], hit[1] = t, cosine
                hit[2], hit[3] = primitives[p, 16], primitives[p, 17]
    return found


@njit(cache=True, error_model="numpy")
def _ground_material(
    x: float,
    y: float,
    surface: int,
    lines: NDArray[np.float64],
    bars: NDArray[np.float64],
    hit: NDArray[np.float64],
) -> None:
    """Fill reflectance and retro gain of a point on the ground; paint lies on the road."""
    hit[3] = 0.0
    if surface != ROAD:
        hit[2] = _CONCRETE if surface == KERB or abs(y) <= SIDEWALK_EDGE_M else _GRASS
        return
    hit[2] = _ASPHALT
    for line in lines:
        if abs(y - line[0]) <= line[1] and (line[2] == 0.0 or x % line[2] <= line[3]):
            hit[2], hit[3] = line[4], line[5]
    for bar in bars:
        if bar[0] <= x <= bar[1] and bar[2] <= y <= bar[3]:
            hit[2], hit[3] = bar[4], bar[5]
