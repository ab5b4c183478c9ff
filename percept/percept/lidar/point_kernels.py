"""The compiled pass that a scan takes on its way into the ground kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["copy_columns"]


@compiled
def copy_columns(points: NDArray[np.float32], columns: NDArray[np.float32]) -> bool:
    """Copy x, y and z apart; return whether all are finite.

    Args:
        points: (N, 3 or more) float32, metres.
        columns: (3, N) float32, written.
    """
    x, y, z = columns[0], columns[1], columns[2]
    finite = True
    for i in range(len(points)):
        x[i] = points[i, 0]
        y[i] = points[i, 1]
        z[i] = points[i, 2]
        # Zero times infinity is no number, and a sum keeps that; a sum of them could overflow.
        zero = np.float32(0.0)
        finite &= x[i] * zero + y[i] * zero + z[i] * zero == zero
    return finite
