"""Equation (1) of `percept.tracking.association`, compiled: all pairs in one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.core.box_overlap_kernels import MOST_CORNERS, giou_3d_of

__all__ = ["fill_pair_costs"]

_F = NDArray[np.float64]
_Function = TypeVar("_Function", bound=Callable[..., object])


def _compiled(function: _Function) -> _Function:
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))


@_compiled
def fill_pair_costs(
    boxes: _F,
    spreads: _F,
    seen: _F,
    seen_spreads: _F,
    gates_m: _F,
    label_costs: _F,
    weights: tuple[float, float, float, float],
    gate_sigma: float,
    costs: _F,
) -> None:
    """Write what `pair_costs` returns, with the weights of distance, size, overlap and label."""
    corners, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    for i in range(len(boxes)):
        for j in range(len(seen)):
            costs[i, j] = np.inf
            x, y = boxes[i, 0] - seen[j, 0], boxes[i, 1] - seen[j, 1]
            if x * x + y * y > gates_m[i, j] ** 2:
                continue
            if not _mahalanobis(x, y, spreads[i], seen_spreads[j]) <= gate_sigma**2:
                continue
            overlap = giou_3d_of(boxes[i], seen[j], corners, spare)
            costs[i, j] = (
                weights[0] * np.sqrt(x * x + y * y) / gates_m[i, j]
                + weights[1] * _size_difference(boxes[i], seen[j])
                + weights[2] * 0.5 * (1.0 - overlap)
                + weights[3] * label_costs[i, j]
            )


@_compiled
def _mahalanobis(x: float, y: float, spread: _F, seen_spread: _F) -> float:
    """Return the squared distance in units of the sum of two covariances (2, 2)."""
    a, c = spread[0, 0] + seen_spread[0, 0], spread[1, 1] + seen_spread[1, 1]
    b = spread[0, 1] + seen_spread[0, 1]
    return float((c * x * x - 2 * b * x * y + a * y * y) / (a * c - b * b))


@_compiled
def _size_difference(a: _F, b: _F) -> float:
    """Return the mean relative difference of longer side, shorter side and height.

    Which side is called the length is not compared: boxes around few points do not know it.
    """
    longer = _relative(max(a[3], a[4]), max(b[3], b[4]))
    shorter = _relative(min(a[3], a[4]), min(b[3], b[4]))
    return (longer + shorter + _relative(a[5], b[5])) / 3


@_compiled
def _relative(a: float, b: float) -> float:
    return abs(a - b) / max(max(a, b), 1e-6)
