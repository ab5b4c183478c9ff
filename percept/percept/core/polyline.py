"""Lines of points: how long they are, and places on them, by the way along them seen from above."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

__all__ = ["along_m", "beside", "length_m", "nearest_place", "points_along", "points_at"]

_F64 = NDArray[np.float64]


def along_m(line: _F64) -> _F64:
    """Return the way (K,) from the start of a line (K, 2 or more) to each of its points."""
    steps = np.diff(line[:, :2], axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])


def length_m(line: _F64) -> float:
    """Return the length of a line (K, 2) seen from above, or (K, 3) in space."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def points_at(line: _F64, at_m: _F64) -> _F64:
    """Return the places (N, D) of a line (K, D) at ways (N,) along it; beyond an end that end."""
    along = along_m(line)
    return np.stack([np.interp(at_m, along, axis) for axis in line.T], axis=1)


def nearest_place(line: _F64, point: _F64) -> _F64:
    """Return the place (D,) of a line (K, D) that is nearest to a point (2,) seen from above."""
    # The last point is a step of no length, so that a line may be a single point.
    steps = np.diff(line, axis=0, append=line[-1:])
    squares = (steps[:, :2] ** 2).sum(axis=1)
    along = ((point - line[:, :2]) * steps[:, :2]).sum(axis=1)
    shares = np.clip(along / np.where(squares > 0, squares, 1.0), 0.0, 1.0)
    places = line + shares[:, None] * steps
    nearest: _F64 = places[int(np.hypot(*(places[:, :2] - point).T).argmin())]
    return nearest


def beside(line: _F64, left_m: float) -> _F64:
    """Return a line (K, 2 or more) of two or more points, moved level to its left."""
    ahead = np.gradient(line[:, :2], axis=0)
    ahead /= np.maximum(np.hypot(ahead[:, :1], ahead[:, 1:]), 1e-9)
    moved = line.copy()
    moved[:, :2] += left_m * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    return moved


def points_along(lines: Collection[_F64], step_m: float) -> _F64:
    """Return points (N, 2) of lines (K, 2 or more), their own and others at most a step apart."""
    if not lines:
        return np.zeros((0, 2))
    starts = np.concatenate([line[:-1, :2] for line in lines])
    steps = np.concatenate([np.diff(line[:, :2], axis=0) for line in lines])
    counts = np.maximum(np.ceil(np.hypot(steps[:, 0], steps[:, 1]) / step_m), 1).astype(np.intp)
    row = np.repeat(np.arange(len(starts)), counts)
    share = (np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[row]
    between = starts[row] + share[:, None] * steps[row]
    return np.concatenate([between, *(line[-1:, :2] for line in lines)])
