"""Height of the ground under objects, so that slopes do not change what an object's height is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ground_height_at"]

_CELL_M = 2.0
# Squares of 3, 7, 15 and 31 cells: the ground around an object, then ever farther away, since an
# object hides the ground behind it and stands on the ground below it.
_REACHES = (1, 3, 7, 15)


def ground_height_at(
    centres_xy: NDArray[np.floating], ground_xyz: NDArray[np.floating], fallback_m: float
) -> NDArray[np.float64]:
    """Return the mean height of the ground points around places.

    Args:
        centres_xy: (K, 2) places, metres, level frame.
        ground_xyz: (N, 3) ground points, metres, same frame.
        fallback_m: Height where there is no ground point within 30 m.

    Returns:
        (K,) float64 z of the ground, metres.
    """
    heights = np.full(len(centres_xy), float(fallback_m))
    if not len(ground_xyz) or not len(centres_xy):
        return heights
    low = ground_xyz[:, :2].min(axis=0)
    rows, columns = (_cells(ground_xyz[:, axis], low[axis]) for axis in (0, 1))
    shape = (int(rows.max()) + 1, int(columns.max()) + 1)
    flat = rows * shape[1] + columns
    size = shape[0] * shape[1]
    counts = _summed(np.bincount(flat, minlength=size).reshape(shape))
    sums = _summed(np.bincount(flat, ground_xyz[:, 2], size).reshape(shape))
    places = np.floor((centres_xy - low) / _CELL_M).astype(np.int64)
    open_ = np.ones(len(heights), dtype=np.bool_)
    for reach in _REACHES:
        count = _window(counts, places, reach)
        found = open_ & (count > 0.5)
        heights[found] = _window(sums, places, reach)[found] / count[found]
        open_ &= ~found
    return heights


def _cells(values: NDArray[np.floating], low: np.floating) -> NDArray[np.int64]:
    return ((values - low) * (1 / _CELL_M)).astype(np.int64)


def _summed(grid: NDArray[np.number]) -> NDArray[np.float64]:
    """Return the summed-area table (Crow 1984), one row and column larger than the grid."""
    table = np.zeros((grid.shape[0] + 1, grid.shape[1] + 1))
    table[1:, 1:] = grid.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    return table


def _window(
    table: NDArray[np.float64], places: NDArray[np.int64], reach: int
) -> NDArray[np.float64]:
    """Return the sum over the square of `2 * reach + 1` cells around each place."""
    limit = np.array(table.shape) - 1
    low = np.clip(places - reach, 0, limit)
    high = np.clip(places + reach + 1, 0, limit)
    inside: NDArray[np.float64] = (
        table[high[:, 0], high[:, 1]]
        - table[low[:, 0], high[:, 1]]
        - table[high[:, 0], low[:, 1]]
        + table[low[:, 0], low[:, 1]]
    )
    return inside
