"""The recursions of smoothing over the steps of a track, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["push_forwards", "smooth_backwards", "smooth_beliefs"]

_F64 = NDArray[np.float64]


@njit(cache=True)
def smooth_backwards(gains: _F64, news: _F64, shrinkage: _F64) -> tuple[_F64, _F64]:
    """Return what the future adds to each filtered state (K, D) and covariance (K, D, D).

    Args:
        gains: (K - 1, D, D) smoother gains G.
        news: (K - 1, D) what each next step changed in its prediction.
        shrinkage: (K - 1, D, D) the same of the covariance.
    """
    count, size = news.shape
    additions = np.zeros((count + 1, size))
    shrunk = np.zeros((count + 1, size, size))
    half = np.zeros((size, size))
    for step in range(count - 1, -1, -1):
        gain = gains[step]
        for i in range(size):
            for k in range(size):
                additions[step, i] += gain[i, k] * (additions[step + 1, k] + news[step, k])
            for j in range(size):
                half[i, j] = 0.0
                for k in range(size):
                    half[i, j] += gain[i, k] * (shrunk[step + 1, k, j] + shrinkage[step, k, j])
        for i in range(size):
            for j in range(size):
                for k in range(size):
                    shrunk[step, i, j] += half[i, k] * gain[j, k]
    return additions, shrunk


@njit(cache=True)
def push_forwards(kept: _F64, pushed: _F64) -> _F64:
    """Return ``change_k = kept_k change_before + pushed_k`` (K, D) for kept (K - 1, D, D)."""
    count, size = pushed.shape
    changes = pushed.copy()
    for step in range(1, count):
        for i in range(size):
            for k in range(size):
                changes[step, i] += kept[step - 1, i, k] * changes[step - 1, k]
    return changes


@njit(cache=True)
def smooth_beliefs(beliefs: _F64, stays: _F64) -> _F64:
    """Return the beliefs (K, C) given all evidence.

    With the transition A to the next step, which is symmetric, a step becomes
    ``alpha * (A (next / (A alpha)))``.

    Args:
        beliefs: (K, C) alpha after each step, given the evidence up to then.
        stays: (K - 1,) share of a belief that is left at the next step; A spreads the rest.
    """
    count, size = beliefs.shape
    smoothed = beliefs.copy()
    for step in range(count - 2, -1, -1):
        stay, spread = stays[step], (1.0 - stays[step]) / size
        ratio = smoothed[step + 1] / (stay * beliefs[step] + spread * beliefs[step].sum())
        product = beliefs[step] * (stay * ratio + spread * ratio.sum())
        smoothed[step] = product / product.sum()
    return smoothed
