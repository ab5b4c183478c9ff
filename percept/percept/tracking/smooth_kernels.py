"""The recursions over the steps of a track, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from percept.tracking.filter_kernels import update_in_place
from percept.tracking.motion_kernels import fill_predictions

__all__ = ["add_backwards", "decayed_sums", "filter_steps", "shrink_backwards", "smooth_beliefs"]

_F64 = NDArray[np.float64]
_Complex = NDArray[np.complex128]


@njit(cache=True)
def filter_steps(
    state: _F64, covariance: _F64, dt_s: _F64, walks: _F64, centres: _F64, variances: _F64
) -> tuple[_F64, _F64]:
    """Return the states (K, 6) and covariances (K, 6, 6) after each of K steps.

    Args:
        state: (1, 6) before them.
        covariance: (1, 6, 6).
        dt_s: (K,) from each step to the one before.
        walks: (K, 3) as for `percept.tracking.motion.predict_turns`.
        centres: (K, 3) measured; NaN for nothing.
        variances: (K, 3) of their errors.
    """
    states, covariances = np.empty((len(dt_s), 6)), np.empty((len(dt_s), 6, 6))
    jacobian = np.empty((1, 6, 6))
    for k in range(len(dt_s)):
        row = slice(k, k + 1)
        fill_predictions(
            state, covariance, dt_s[row], walks[row], states[row], covariances[row], jacobian
        )
        if np.isfinite(centres[k, 0]):
            update_in_place(states[row], covariances[row], centres[row], variances[row])
        state, covariance = states[row], covariances[row]
    return states, covariances


@njit(cache=True)
def add_backwards(gains: _F64, news: _F64) -> _F64:
    """Return what the future adds to each filtered state (K, D).

    Args:
        gains: (K - 1, D, D) smoother gains G.
        news: (K - 1, D) what each next step changed in its prediction.
    """
    count, size = news.shape
    additions = np.zeros((count + 1, size))
    for step in range(count - 1, -1, -1):
        for i in range(size):
            for k in range(size):
                additions[step, i] += gains[step, i, k] * (additions[step + 1, k] + news[step, k])
    return additions


@njit(cache=True)
def shrink_backwards(gains: _F64, shrinkage: _F64) -> _F64:
    """Return what the future adds to each filtered covariance (K, D, D): nothing positive.

    Args:
        gains: (K - 1, D, D) smoother gains G.
        shrinkage: (K - 1, D, D) what each next step changed in the predicted covariance.
    """
    count, size = shrinkage.shape[:2]
    shrunk = np.zeros((count + 1, size, size))
    half = np.zeros((size, size))
    for step in range(count - 1, -1, -1):
        gain = gains[step]
        for i in range(size):
            for j in range(size):
                half[i, j] = 0.0
                for k in range(size):
                    half[i, j] += gain[i, k] * (shrunk[step + 1, k, j] + shrinkage[step, k, j])
        for i in range(size):
            for j in range(size):
                for k in range(size):
                    shrunk[step, i, j] += half[i, k] * gain[j, k]
    return shrunk


@njit(cache=True)
def decayed_sums(vectors: _Complex, decays: _F64) -> _Complex:
    """Return for each of K vectors the sum of all, each decayed by the K - 1 steps between."""
    before, after = vectors.copy(), vectors.copy()
    for step in range(1, len(vectors)):
        before[step] += decays[step - 1] * before[step - 1]
        after[-1 - step] += decays[-step] * after[-step]
    return before + after - vectors


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
