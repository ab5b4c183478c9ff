"""The motion of `percept.tracking.motion`, compiled: all tracks in one call.

A drive has few tracks at a time, so that in NumPy most of the time would go into calling it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["fill_predictions"]

_F = NDArray[np.float64]
_Function = TypeVar("_Function", bound=Callable[..., object])

_SIZE = 6
_SMALL_ANGLE_RAD = 1e-3
_NO_ANGLE_RAD = 1e-10


def _compiled(function: _Function) -> _Function:
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))


@_compiled
def fill_predictions(
    states: _F, covariances: _F, dt_s: _F, walks: _F, moved: _F, spreads: _F, jacobians: _F
) -> None:
    """Write what `predict_turns` returns: (N, 6), (N, 6, 6) and (N, 6, 6)."""
    half = np.empty((_SIZE, _SIZE))
    for k in range(len(states)):
        _fill_jacobian(states[k], dt_s[k], jacobians[k])
        _move(states[k], jacobians[k], moved[k])
        _spread(covariances[k], jacobians[k], half, spreads[k])
        _add_noise(dt_s[k], walks[k], spreads[k])


@_compiled
def _fill_jacobian(state: _F, dt_s: float, jacobian: _F) -> None:
    """Write the derivative of the state after a time by the state before."""
    vx, vy = state[3], state[4]
    angle = state[5] * dt_s
    sine, cosine = np.sin(angle), np.cos(angle)
    along, half = _sinc(angle), _sinc(0.5 * angle)
    across = 0.5 * angle * half**2  # (1 - cos a)/a, without a difference of near numbers
    small = np.abs(angle) < _SMALL_ANGLE_RAD
    along_by_angle = -angle / 3 if small else (cosine - along) / angle
    across_by_angle = along - 0.5 * half**2

    jacobian[:] = 0.0
    for i in range(_SIZE):
        jacobian[i, i] = 1.0
    jacobian[0, 3] = jacobian[1, 4] = dt_s * along
    jacobian[1, 3] = dt_s * across
    jacobian[0, 4] = -dt_s * across
    jacobian[3, 3] = jacobian[4, 4] = cosine
    jacobian[4, 3], jacobian[3, 4] = sine, -sine
    jacobian[0, 5] = dt_s**2 * (along_by_angle * vx - across_by_angle * vy)
    jacobian[1, 5] = dt_s**2 * (across_by_angle * vx + along_by_angle * vy)
    jacobian[3, 5] = dt_s * (-sine * vx - cosine * vy)
    jacobian[4, 5] = dt_s * (cosine * vx - sine * vy)


@_compiled
def _sinc(angle: float) -> float:
    """Return sin(a) / a."""
    return float(np.sin(angle) / angle) if abs(angle) > _NO_ANGLE_RAD else 1.0


@_compiled
def _move(state: _F, jacobian: _F, moved: _F) -> None:
    """Write F x; the model is linear in position and velocity: all but the turn rate."""
    moved[5] = state[5]
    for i in range(_SIZE - 1):
        moved[i] = 0.0
        for k in range(_SIZE - 1):
            moved[i] += jacobian[i, k] * state[k]


@_compiled
def _spread(covariance: _F, jacobian: _F, half: _F, spread: _F) -> None:
    """Write F P F'."""
    for i in range(_SIZE):
        for j in range(_SIZE):
            half[i, j] = 0.0
            for k in range(_SIZE):
                half[i, j] += jacobian[i, k] * covariance[k, j]
    for i in range(_SIZE):
        for j in range(_SIZE):
            spread[i, j] = 0.0
            for k in range(_SIZE):
                spread[i, j] += half[i, k] * jacobian[j, k]


@_compiled
def _add_noise(dt_s: float, walks: _F, spread: _F) -> None:
    """Add the noise Q of white accelerations over a time."""
    velocity, height, turn = walks[0] ** 2, walks[1] ** 2, walks[2] ** 2
    for position in range(2):
        rate = position + 3
        spread[position, position] += velocity * dt_s**3 / 3
        spread[position, rate] += velocity * dt_s**2 / 2
        spread[rate, position] += velocity * dt_s**2 / 2
        spread[rate, rate] += velocity * dt_s
    spread[2, 2] += height * dt_s
    spread[5, 5] += turn * dt_s
