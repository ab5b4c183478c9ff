"""The grid cells of a detector, one box each (or three): their number tells the layout."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["STRIDES", "Cells", "cells_of", "count_cells", "strides_of"]

# Strides of the grids that YOLO networks have: most; v3-tiny and v4-tiny; P6; P2; and smaller ones.
STRIDES = ((8, 16, 32), (16, 32), (8, 16, 32, 64), (4, 8, 16, 32), (4, 8, 16), (8, 16))

Cells = tuple[NDArray[np.float64], NDArray[np.float64]]


def count_cells(size: tuple[int, int], strides: tuple[int, ...]) -> int:
    """Return the number of cells of all grids over an input of `size` (width, height)."""
    return sum(-(-size[0] // s) * -(-size[1] // s) for s in strides)


def strides_of(size: tuple[int, int], cells: int) -> tuple[int, ...] | None:
    """Return the strides whose grids have so many cells together, or None."""
    return next((s for s in STRIDES if count_cells(size, s) == cells), None)


@lru_cache(maxsize=32)
def cells_of(size: tuple[int, int], strides: tuple[int, ...]) -> Cells:
    """Return the (N, 2) column and row and the (N, 1) stride of every cell, grid by grid."""
    corners, steps = [], []
    for stride in strides:
        rows, columns = np.indices((-(-size[1] // stride), -(-size[0] // stride)))
        corners.append(np.stack([columns.ravel(), rows.ravel()], axis=1))
        steps.append(np.full((rows.size, 1), stride))
    return np.concatenate(corners).astype(np.float64), np.concatenate(steps).astype(np.float64)
