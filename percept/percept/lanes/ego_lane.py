"""Which two lines bound the lane that the vehicle is in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from percept.lanes.lines import PaintLine
from percept.lanes.road_grid import RoadGrid

__all__ = ["choose_lane"]

_BETWEEN = 1.0  # how much paint inside of a lane speaks against it
_AHEAD_M = 15.0
_PARALLEL = 0.15  # logarithm of the ratio of widths there and here
_ALONE = 0.3  # how much one line is worth against two that fit


def choose_lane(
    lines: Sequence[PaintLine],
    grid: RoadGrid,
    width_m: tuple[float, float],
) -> tuple[PaintLine | None, PaintLine | None]:
    """Return the lines on the left and on the right of the vehicle, None where there is none.

    Of all pairs of a plausible width, and all single lines, those win that have most paint, less
    the paint of lines between them: a lane holds none.

    Args:
        lines: What was found, in any order.
        grid: The grid; the vehicle is on the lateral place of its camera.
        width_m: Bounds of the lane's width.
    """
    middle, near = float(grid.eye_m[1]), grid.x_m[:1]
    places = [float(line.at(near)[0]) - middle for line in lines]
    paint = [line.weight for line in lines]
    left = [k for k, y in enumerate(places) if 0 < y < width_m[1]]
    right = [k for k, y in enumerate(places) if 0 >= y > -width_m[1]]
    best: tuple[float, int | None, int | None] = (0.0, None, None)
    for i in [None, *left]:
        for j in [None, *right]:
            low = 0.0 if j is None else places[j]
            high = 0.0 if i is None else places[i]
            if i is not None and j is not None and not width_m[0] <= high - low <= width_m[1]:
                continue
            between = sum(p for p, y in zip(paint, places, strict=True) if low < y < high)
            if i is not None and j is not None:
                # Both sides need paint: the geometric mean of theirs.
                both = 2 * float(np.sqrt(paint[i] * paint[j])) * _likely(high - low, width_m)
                both *= _parallel(lines[i], lines[j], float(near[0]))
            else:
                both = _ALONE * sum(paint[k] for k in (i, j) if k is not None)
            score = both - _BETWEEN * between
            best = max(best, (score, i, j), key=lambda choice: choice[0])
    _, i, j = best
    return None if i is None else lines[i], None if j is None else lines[j]


def _likely(width_m: float, bounds_m: tuple[float, float]) -> float:
    """Return how likely a lane's width is, 1 at the middle of its bounds and e^-2 at both."""
    low, high = np.log(bounds_m)
    return float(np.exp(-2 * ((np.log(width_m) - (low + high) / 2) / ((high - low) / 2)) ** 2))


def _parallel(left: PaintLine, right: PaintLine, near_m: float) -> float:
    """Return how parallel two lines are, 1 where they keep their distance over `_AHEAD_M`."""
    first, last = (
        left.at(np.array([x])) - right.at(np.array([x])) for x in (near_m, near_m + _AHEAD_M)
    )
    ratio = max(float(last[0]), 0.01) / max(float(first[0]), 0.01)
    return float(np.exp(-0.5 * (np.log(ratio) / _PARALLEL) ** 2))
