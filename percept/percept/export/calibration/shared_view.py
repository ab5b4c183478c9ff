"""Where in a merged cloud two sensors see the same upright things: the places to look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["busiest_places"]

_F64 = NDArray[np.float64]
_COLUMN_M = 0.4
_UPRIGHT_M = 0.7
_NEAR_M = 3.0  # closer is the vehicle itself


def busiest_places(
    first: NDArray[np.floating], second: NDArray[np.floating], size_m: float, most: int
) -> list[tuple[_F64, str]]:
    """Find the squares in which most columns hold upright things that both sensors see.

    Args:
        first: (N, 3) metres.
        second: (M, 3) metres in the same frame, whose z is about up.
        size_m: Side of the squares.
        most: How many places, which are this far apart.

    Returns:
        For each place its centre (3,), and the axis, "x" or "y", along which things lie there: a
        picture from the side shows that one.
    """
    shared = _shared_columns(first, second)
    found: list[tuple[_F64, str]] = []
    while len(shared) and len(found) < most:
        inside = np.abs(shared[:, None, :2] - shared[None, :, :2]).max(axis=2) < size_m / 2
        centre = shared[int(np.argmax(inside.sum(axis=1)))]
        near = np.abs(shared[:, :2] - centre[:2]).max(axis=1)
        here = shared[near < size_m / 2]
        spread = here[:, :2].std(axis=0)
        found.append((here.mean(axis=0), "x" if spread[0] >= spread[1] else "y"))
        shared = shared[near >= size_m]
    return found


def _shared_columns(first: NDArray[np.floating], second: NDArray[np.floating]) -> _F64:
    """Return the middles (K, 3) of columns in which both sensors see something upright."""
    tall = [_tall_columns(np.asarray(points, dtype=np.float64)) for points in (first, second)]
    keys = sorted(set(tall[0]) & set(tall[1]))
    middles = [
        (
            (key[0] + 0.5) * _COLUMN_M,
            (key[1] + 0.5) * _COLUMN_M,
            (tall[0][key] + tall[1][key]) / 2,
        )
        for key in keys
    ]
    return np.array(middles).reshape(-1, 3)


def _tall_columns(points: _F64) -> dict[tuple[int, int], float]:
    """Return the middle height of the columns whose points span some height."""
    points = points[np.isfinite(points).all(axis=1)]
    far = points[np.hypot(points[:, 0], points[:, 1]) > _NEAR_M]
    if len(far) == 0:
        return {}
    cells, at = np.unique(
        np.floor(far[:, :2] / _COLUMN_M).astype(np.int64), axis=0, return_inverse=True
    )
    low, high = np.full(len(cells), np.inf), np.full(len(cells), -np.inf)
    np.minimum.at(low, at.ravel(), far[:, 2])
    np.maximum.at(high, at.ravel(), far[:, 2])
    tall = high - low > _UPRIGHT_M
    middles = (low + high) / 2
    return {
        (int(x), int(y)): float(z)
        for (x, y), z in zip(cells[tall].tolist(), middles[tall].tolist(), strict=True)
    }
