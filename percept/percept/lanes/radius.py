"""The radius of a lane, from its lines."""

from __future__ import annotations

import numpy as np

from percept.core.lane_markings import LaneDetections

__all__ = ["lane_radius"]

_STRAIGHT_M = 1e5


def lane_radius(found: LaneDetections) -> float | None:
    """Return the radius in metres of the lane at the vehicle, at most 100 km; None without a scale.

    One curvature is fitted to the lane's lines together, each point with the weight of its spread.
    """
    lines = [line for side in ("left", "right") if (line := found.line(side)) is not None]
    lines = [line for line in lines if len(line.points_m) > 3]
    if not lines:
        return None
    rows, values = [], []
    for k, line in enumerate(lines):
        x, y = line.points_m.T
        own = np.zeros((len(x), len(lines)))
        own[:, k] = 1
        weight = 1 / line.sd_m
        rows.append(np.column_stack([own, x, x**2]) * weight[:, None])
        values.append(y * weight)
    solution = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
    slope, bend = solution[-2:]
    return float(min((1 + slope**2) ** 1.5 / max(abs(2 * bend), 1e-12), _STRAIGHT_M))
