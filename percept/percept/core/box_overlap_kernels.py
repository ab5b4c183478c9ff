"""Numba kernels of `percept.core.box_overlap`: all pairs of two sets of boxes in one call.

Each pair is looked at in the frame of its first box, which lies along the axes there: clipping
needs four half planes only, and boxes far from the origin of a map lose no digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["MOST_CORNERS", "fill_giou_3d", "fill_iou_3d", "fill_iou_bev", "giou_3d_of"]

_CORNERS = 4
_HULL_POINTS = 8
# Eight corners are left of two rectangles. Rounding may leave an outline that is not quite convex,
# of which each of four cuts can make one half longer at most: 4, 6, 9, 13, 19.
MOST_CORNERS = 20

_F = NDArray[np.float64]
_Function = TypeVar("_Function", bound=Callable[..., object])


def _compiled(function: _Function) -> _Function:
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))


@_compiled
def fill_iou_bev(a: _F, b: _F, out: _F) -> None:
    """Write the IoU in bird's-eye view of boxes (N, 7) and (M, 7) into (N, M)."""
    corners, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    for i in range(len(a)):
        for j in range(len(b)):
            reach = 0.5 * (a[i, 3] + a[i, 4] + b[j, 3] + b[j, 4])
            if (b[j, 0] - a[i, 0]) ** 2 + (b[j, 1] - a[i, 1]) ** 2 >= reach * reach:
                out[i, j] = 0.0  # most pairs, which then cost next to nothing
                continue
            shared = _shared_area(a[i], b[j], corners, spare)
            union = a[i, 3] * a[i, 4] + b[j, 3] * b[j, 4] - shared
            out[i, j] = shared / union if union > 0.0 else 0.0


@_compiled
def fill_iou_3d(a: _F, b: _F, out: _F) -> None:
    """Write the IoU in space of boxes (N, 7) and (M, 7) into (N, M)."""
    corners, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    for i in range(len(a)):
        for j in range(len(b)):
            shared, union = _volumes(a[i], b[j], corners, spare)
            out[i, j] = shared / union if union > 0.0 else 0.0


@_compiled
def fill_giou_3d(a: _F, b: _F, within_m: float, out: _F) -> None:
    """Write the generalised IoU in space into (N, M); -1 of centres farther apart than a limit."""
    corners, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    for i in range(len(a)):
        for j in range(len(b)):
            if np.hypot(b[j, 0] - a[i, 0], b[j, 1] - a[i, 1]) > within_m:
                out[i, j] = -1.0
                continue
            out[i, j] = giou_3d_of(a[i], b[j], corners, spare)


@_compiled
def giou_3d_of(a: _F, b: _F, corners: _F, spare: _F) -> float:
    """Return the generalised IoU in space of two boxes (7,); the rest is room (MOST_CORNERS, 2)."""
    shared, union = _volumes(a, b, corners, spare)
    top = max(a[2] + 0.5 * a[5], b[2] + 0.5 * b[5])
    bottom = min(a[2] - 0.5 * a[5], b[2] - 0.5 * b[5])
    hull = _hull_area(a, b, corners, spare) * (top - bottom)
    iou = shared / union if union > 0.0 else 0.0
    return iou - (hull - union) / hull if hull > 0.0 else -1.0


@_compiled
def _volumes(a: _F, b: _F, corners: _F, spare: _F) -> tuple[float, float]:
    """Return the volumes of intersection and union of two boxes."""
    top = min(a[2] + 0.5 * a[5], b[2] + 0.5 * b[5])
    bottom = max(a[2] - 0.5 * a[5], b[2] - 0.5 * b[5])
    shared = (top - bottom) * _shared_area(a, b, corners, spare) if top > bottom else 0.0
    return shared, a[3] * a[4] * a[5] + b[3] * b[4] * b[5] - shared


@_compiled
def _shared_area(a: _F, b: _F, corners: _F, spare: _F) -> float:
    """Return the area that two rectangles share (Sutherland and Hodgman, 1974)."""
    reach = 0.5 * (np.hypot(a[3], a[4]) + np.hypot(b[3], b[4]))
    if (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 >= reach * reach:
        return 0.0
    _place_corners(a, b, corners)
    half_length, half_width = 0.5 * a[3], 0.5 * a[4]
    count = _clip(corners, _CORNERS, 0, 1.0, half_length, spare)
    count = _clip(spare, count, 0, -1.0, half_length, corners)
    count = _clip(corners, count, 1, 1.0, half_width, spare)
    count = _clip(spare, count, 1, -1.0, half_width, corners)
    return _area(corners, count)


@_compiled
def _place_corners(a: _F, b: _F, corners: _F) -> None:
    """Write the corners of box b in the frame of box a, counter-clockwise."""
    cosine, sine = np.cos(a[6]), np.sin(a[6])
    x = cosine * (b[0] - a[0]) + sine * (b[1] - a[1])
    y = cosine * (b[1] - a[1]) - sine * (b[0] - a[0])
    along, across = np.cos(b[6] - a[6]), np.sin(b[6] - a[6])
    for k in range(_CORNERS):
        half_length = 0.5 * b[3] if k in (0, 3) else -0.5 * b[3]
        half_width = 0.5 * b[4] if k < 2 else -0.5 * b[4]
        corners[k, 0] = x + along * half_length - across * half_width
        corners[k, 1] = y + across * half_length + along * half_width


@_compiled
def _clip(corners: _F, count: int, axis: int, sign: float, limit: float, out: _F) -> int:
    """Keep the part of a convex polygon where ``sign * axis <= limit``; return its corners."""
    kept = 0
    for k in range(count):
        here, after = corners[k], corners[(k + 1) % count]
        inside, inside_after = limit - sign * here[axis], limit - sign * after[axis]
        if inside >= 0.0:
            out[kept] = here
            kept += 1
        if (inside >= 0.0) != (inside_after >= 0.0):
            share = inside / (inside - inside_after)
            out[kept, 0] = here[0] + share * (after[0] - here[0])
            out[kept, 1] = here[1] + share * (after[1] - here[1])
            kept += 1
    return kept


@_compiled
def _area(corners: _F, count: int) -> float:
    """Return the area of a polygon (shoelace formula)."""
    twice = 0.0
    for k in range(count):
        after = (k + 1) % count
        twice += corners[k, 0] * corners[after, 1] - corners[after, 0] * corners[k, 1]
    return abs(0.5 * twice)


@_compiled
def _hull_area(a: _F, b: _F, points: _F, hull: _F) -> float:
    """Return the area of the convex hull of two rectangles (monotone chain; Andrew, 1979)."""
    _place_corners(a, b, points)
    for k in range(_CORNERS):
        points[_CORNERS + k, 0] = 0.5 * a[3] if k in (0, 3) else -0.5 * a[3]
        points[_CORNERS + k, 1] = 0.5 * a[4] if k < 2 else -0.5 * a[4]
    _sort_points(points)
    return _chain_area(points, 1.0, hull) + _chain_area(points, -1.0, hull)


@_compiled
def _sort_points(points: _F) -> None:
    """Sort points by x, then y, in place."""
    for k in range(1, _HULL_POINTS):
        x, y = points[k, 0], points[k, 1]
        place = k
        while place > 0 and (
            points[place - 1, 0] > x or (points[place - 1, 0] == x and points[place - 1, 1] > y)
        ):
            points[place, 0], points[place, 1] = points[place - 1, 0], points[place - 1, 1]
            place -= 1
        points[place, 0], points[place, 1] = x, y


@_compiled
def _chain_area(points: _F, side: float, chain: _F) -> float:
    """Return the area between one side of the hull and the line from first to last point."""
    count = 0
    for k in range(_HULL_POINTS):
        x, y = points[k, 0], points[k, 1]
        while count > 1 and side * _turn(chain[count - 2], chain[count - 1], x, y) <= 0.0:
            count -= 1
        chain[count, 0], chain[count, 1] = x, y
        count += 1
    return _area(chain, count)


@_compiled
def _turn(before: _F, here: _F, x: float, y: float) -> float:
    """Return a positive number where the way over two points to (x, y) bends left."""
    ahead = (here[0] - before[0]) * (y - before[1])
    return float(ahead - (here[1] - before[1]) * (x - before[0]))
