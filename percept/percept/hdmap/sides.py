"""On which side of a line points lie, as Lanelet2 decides it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["aligned", "is_left_of"]

_F64 = NDArray[np.float64]


def aligned(left: _F64, right: _F64) -> tuple[bool, bool]:
    """Return whether a left and a right border have to be turned to run along one lane.

    As Lanelet2's `geometry::align`: the middle point of the right border has to lie right of the
    left one; then the middle of the left one, turned, left of the right one.

    Args:
        left: (K, 2 or 3) float64.
        right: (M, 2 or 3) float64.
    """
    turn_left = is_left_of(_middle(right), left)
    turn_right = not is_left_of(_middle(left[::-1] if turn_left else left), right)
    return turn_left, turn_right


def _middle(line: _F64) -> _F64:
    """Return the middle point (2,): of more than two points the one in the middle of the list."""
    middle: _F64 = line[len(line) // 2] if len(line) > 2 else (line[0] + line[-1]) / 2
    return middle[:2]


def is_left_of(point: _F64, line: _F64) -> bool:
    """Return whether a point (2,) lies left of a line (K, 2 or 3) by the segment next to it.

    Where a corner of the line is what is next, the turn of the line there decides: left of the
    line is what is left of both segments at a left turn, and of either at a right turn.
    """
    starts, steps = line[:-1, :2], line[1:, :2] - line[:-1, :2]
    squares = np.einsum("ij,ij->i", steps, steps)
    if not squares.all():
        real = squares > 0
        if not real.any():
            return False
        starts, steps, squares = starts[real], steps[real], squares[real]
    away = point - starts
    shares = np.minimum(np.maximum(np.einsum("ij,ij->i", away, steps) / squares, 0.0), 1.0)
    offsets = away - shares[:, None] * steps
    nearest = int(np.einsum("ij,ij->i", offsets, offsets).argmin())
    side = _cross(steps[nearest], point - starts[nearest])
    if shares[nearest] < 1.0 or nearest + 1 == len(steps):
        return side > 0
    after = _cross(steps[nearest + 1], point - starts[nearest + 1])
    left_turn = _cross(steps[nearest], steps[nearest + 1]) > 0
    return (side > 0 and after > 0) if left_turn else (side > 0 or after > 0)


def _cross(a: _F64, b: _F64) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
