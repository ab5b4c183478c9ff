"""The slab test of many lines of sight against many boxes, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["hide"]


@njit(cache=True, nogil=True)
def hide(
    starts: NDArray[np.float64],
    axes: NDArray[np.float64],
    halves: NDArray[np.float64],
    ways: NDArray[np.float64],
    before: float,
    hidden: NDArray[np.bool_],
) -> None:
    """Mark which lines of sight pass through a box.

    Args:
        starts: (M, 3) the eye in the frame of each box.
        axes: (M, 2) cosine and sine of each box's yaw.
        halves: (M, 3) half of each box's size.
        ways: (N, 3) from the eye to each point.
        before: Share of the way from which a box no longer hides.
        hidden: (N,) is set where a line passes through a box.
    """
    way = np.empty(3)
    for n in range(len(ways)):
        for m in range(len(starts)):
            way[0] = axes[m, 0] * ways[n, 0] + axes[m, 1] * ways[n, 1]
            way[1] = axes[m, 0] * ways[n, 1] - axes[m, 1] * ways[n, 0]
            way[2] = ways[n, 2]
            first, last = 0.0, before
            for k in range(3):
                step = way[k]
                if abs(step) < 1e-12:
                    step = 1e-12
                one = (-halves[m, k] - starts[m, k]) / step
                other = (halves[m, k] - starts[m, k]) / step
                first = max(first, min(one, other))
                last = min(last, max(one, other))
                if first > last:
                    break
            if first < last:
                hidden[n] = True
                break
