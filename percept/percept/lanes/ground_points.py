"""The surface of the road from LiDAR points.

It starts at the lowest level near the vehicle that many points share, wherever the vehicle's frame
has its origin. From there outwards, piece by piece: the ground of a piece is looked for near where
that of the pieces before leads, so that cars and walls, which stand above it, are passed over.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.lanes.ground import GroundSurface, flat_ground

__all__ = ["ground_from_points"]

_F64 = NDArray[np.float64]
_Knot = tuple[float, float, float]

_PIECE_M = 2.0
_REACH_M = (-6.0, 32.0)
_HALF_WIDTH_M = 6.0
_GATE_M = 0.25  # a kerb is lower, the steepest change of grade of a street less, over a piece
_LEAST_POINTS = 12
_LEAST_PIECES = 4
_LOW_SHARE = 0.35  # things stand on the ground, and not below it
_FIT_M = 0.06
_FLOOR_SD_M = 0.01
_HIGHEST_M = 3.0  # of the road below or above the origin of the vehicle's frame
_STARTS_M = ((4.0, 10.0), (-6.0, 4.0))  # ahead of the bonnet, where LiDARs see the road; else
_START_HALF_WIDTH_M = 3.0
_LEVEL_M = 0.2
_CROSS_GATE_M = 0.6  # above and below the start, at the edges of a road that leans
_DENSE = 0.15  # of the points of the level that has most: a car is seen by more than the road below
_STEEPEST = 0.15  # no street changes its grade by more
_WIDEST_GAP_M = 8.0  # beyond it, the height to look at is a guess


def ground_from_points(points_base: NDArray[np.floating]) -> GroundSurface:
    """Return the road's surface in the vehicle's frame, or flat ground with a note.

    Args:
        points_base: (N, 3) points of one moment in the vehicle's frame, whose origin is within
            3 m of the road's height.
    """
    points = np.asarray(points_base, dtype=np.float64)
    near = (np.abs(points[:, 1]) < _HALF_WIDTH_M) & (np.abs(points[:, 2]) < _HIGHEST_M)
    near &= (points[:, 0] > _REACH_M[0]) & (points[:, 0] < _REACH_M[1])
    points = points[near]
    start = _start(points)
    low = points if start is None else points[np.abs(points[:, 2] - start[1]) < _CROSS_GATE_M]
    slope = _cross_slope(low)
    level = points[:, 2] - slope * points[:, 1]
    knots = [] if start is None else _pieces(points[:, 0], level, start)
    if len(knots) < _LEAST_PIECES or max(knots)[0] < _STARTS_M[0][0]:
        note = "Too few points of the LiDAR lie on the road ahead: it is taken as flat."
        return replace(flat_ground(0.0 if start is None else start[1]), notes=(note,))
    x, z, sd = np.array(_apart(sorted(knots))).T
    return GroundSurface(x_m=x, z_m=z, sd_m=sd, cross_slope=slope, source="points")


def _start(points: _F64) -> tuple[float, float] | None:
    """Return a place near and the lowest level there that many points share.

    Most of what a LiDAR sees near a vehicle is road, and what stands on it is higher.
    """
    edges = np.arange(-_HIGHEST_M - _LEVEL_M, _HIGHEST_M + _LEVEL_M, _LEVEL_M / 2)
    for first, last in _STARTS_M:
        inside = (points[:, 0] > first) & (points[:, 0] < last)
        near = points[inside & (np.abs(points[:, 1]) < _START_HALF_WIDTH_M), 2]
        count = np.histogram(near, edges)[0]
        pairs = count[:-1] + count[1:]  # a road between two bins is one level
        if pairs.max() < _LEAST_POINTS:
            continue
        lowest = int((pairs >= max(_DENSE * pairs.max(), _LEAST_POINTS)).argmax())
        shared = near[(near >= edges[lowest]) & (near < edges[lowest + 2])]
        return (first + last) / 2, float(np.median(shared))
    return None


def _pieces(x: _F64, level: _F64, start: tuple[float, float]) -> list[_Knot]:
    """Return middle, height and spread of each piece in which the ground is seen."""
    order = np.argsort(x)
    x, level = x[order], level[order]
    edges = np.arange(_REACH_M[0], _REACH_M[1] + _PIECE_M, _PIECE_M)
    rows = np.searchsorted(x, edges)
    first = int(np.searchsorted(edges, _STARTS_M[0][0]))
    found: list[_Knot] = []
    for sequence in (range(first, len(edges) - 1), range(first - 1, -1, -1)):
        recent = found[:2]
        for k in sequence:
            piece, middle = (
                slice(int(rows[k]), int(rows[k + 1])),
                float(edges[k] + edges[k + 1]) / 2,
            )
            if abs(middle - (recent[0] if recent else start)[0]) > _WIDEST_GAP_M:
                break
            expected = _expected(recent, middle) if recent else start[1]
            knot = _knot(x[piece], level[piece], expected)
            if knot is not None:
                found.append(knot)
                recent = [knot, *recent[:1]]
    return found


def _apart(knots: list[_Knot]) -> list[_Knot]:
    """Make one of neighbours that lie so near to each other that their grade is chance."""
    kept = knots[:1]
    for knot in knots[1:]:
        if knot[0] - kept[-1][0] < _PIECE_M / 2:
            x, z, sd = (np.array(kept[-1]) + knot) / 2
            kept[-1] = (float(x), float(z), float(sd))
        else:
            kept.append(knot)
    return kept


def _expected(recent: list[_Knot], x: float) -> float:
    """Return the height to which the last pieces lead."""
    if len(recent) < 2:
        return recent[0][1]
    (x1, z1, _), (x0, z0, _) = recent
    grade = min(max((z1 - z0) / (x1 - x0), -_STEEPEST), _STEEPEST)
    return z1 + grade * (x - x1)


def _knot(x: _F64, level: _F64, expected: float) -> _Knot | None:
    """Return the ground of a piece: the level that most of its low points share."""
    close = np.abs(level - expected) < _GATE_M
    if close.sum() < _LEAST_POINTS:
        return None
    x, level = x[close], level[close]
    low = float(np.quantile(level, _LOW_SHARE))
    ground = np.abs(level - low) < _FIT_M
    count = int(ground.sum())
    if count < _LEAST_POINTS // 2:
        return None
    # Neighbouring points of one ring err together: they count as a few.
    sd = float(np.std(level[ground])) / np.sqrt(max(count / 20, 1.0))
    return (
        float(x[ground].mean()),
        float(np.median(level[ground])),
        float(np.hypot(sd, _FLOOR_SD_M)),
    )


def _cross_slope(points: _F64) -> float:
    """Return the slope across of the road about the vehicle: the median of pairs (Sen 1968)."""
    near = points[(points[:, 0] > 2.0) & (points[:, 0] < 14.0) & (np.abs(points[:, 1]) < 4.0)]
    slopes = []
    for start in np.arange(2.0, 14.0, 1.0):
        row = near[(near[:, 0] >= start) & (near[:, 0] < start + 1.0)]
        left, right = row[row[:, 1] > 1.0], row[row[:, 1] < -1.0]
        if min(len(left), len(right)) < _LEAST_POINTS // 2:
            continue
        heights = [float(np.quantile(side[:, 2], _LOW_SHARE)) for side in (left, right)]
        places = [float(np.median(side[:, 1])) for side in (left, right)]
        slopes.append((heights[0] - heights[1]) / (places[0] - places[1]))
    return float(np.clip(np.median(slopes), -0.08, 0.08)) if len(slopes) >= 3 else 0.0
