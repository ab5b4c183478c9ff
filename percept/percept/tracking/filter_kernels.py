"""The filters of `percept.tracking.filter`, compiled: all detections of a scan in one call."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["align_shapes", "move_shapes", "turn_shapes", "update_in_place", "widen"]

_F = NDArray[np.float64]
_Flags = NDArray[np.bool_]
_Function = TypeVar("_Function", bound=Callable[..., object])

_SIZE = 6
_QUARTER_RAD = np.pi / 2
_MOST_FACING = 10.0
_COURSE_VOTE = 3.0
_COURSE_SIGMAS = 3.0
_COURSE_MPS = 1.0
_ACROSS = np.cos(np.radians(60.0))
_ALONG = np.cos(np.radians(45.0))
_WIDER = 1.2


def _compiled(function: _Function) -> _Function:
    return cast("_Function", njit(cache=True, error_model="numpy", nogil=True)(function))


@_compiled
def update_in_place(states: _F, covariances: _F, centres: _F, variances: _F) -> None:
    """Put measured centres (N, 3) into states (N, 6) and covariances (N, 6, 6).

    One coordinate after the other, which is the same as all three at once since their errors are
    independent (Bar-Shalom, Li, Kirubarajan, 2001, section 7.2.2), and needs no inverse.
    """
    gain, half = np.empty(_SIZE), np.empty((_SIZE, _SIZE))
    for k in range(len(states)):
        state, covariance = states[k], covariances[k]
        for axis in range(3):
            residual = centres[k, axis] - state[axis]
            innovation = covariance[axis, axis] + variances[k, axis]
            for i in range(_SIZE):
                gain[i] = covariance[i, axis] / innovation
                state[i] += gain[i] * residual
            _joseph(covariance, gain, axis, variances[k, axis], half)


@_compiled
def _joseph(covariance: _F, gain: _F, axis: int, variance: float, half: _F) -> None:
    """Replace P by (I - K H) P (I - K H)' + K r K', where H picks one coordinate."""
    for i in range(_SIZE):
        for j in range(_SIZE):
            half[i, j] = covariance[i, j] - gain[i] * covariance[axis, j]
    for i in range(_SIZE):
        for j in range(i + 1):
            kept = half[i, j] - half[i, axis] * gain[j]
            covariance[i, j] = covariance[j, i] = kept + gain[i] * variance * gain[j]


@_compiled
def align_shapes(shapes: _F, measured: _F, aligned: _F, agreed: _Flags) -> None:
    """Write what `aligned_shapes` returns."""
    for k in range(len(shapes)):
        length, width, yaw = measured[k, 0], measured[k, 1], measured[k, 3]
        straight = _size_difference(shapes[k], length, width)
        swapped = _size_difference(shapes[k], width, length)
        best, least = 0, np.inf
        for turns in range(4):
            turned = 1.0 - np.cos(yaw + turns * _QUARTER_RAD - shapes[k, 3])
            cost = turned + (swapped if turns % 2 else straight)
            if cost < least:
                best, least = turns, cost
        agreed[k] = best == 0
        aligned[k, 0] = width if best % 2 else length
        aligned[k, 1] = length if best % 2 else width
        aligned[k, 2] = measured[k, 2]
        aligned[k, 3] = _wrapped(yaw + best * _QUARTER_RAD)


@_compiled
def _size_difference(shape: _F, length: float, width: float) -> float:
    """Return the mean relative difference of length and width."""
    longer = max(max(shape[0], length), 1e-6)
    wider = max(max(shape[1], width), 1e-6)
    return float(0.5 * (abs(shape[0] - length) / longer + abs(shape[1] - width) / wider))


@_compiled
def widen(variances: _F, shapes: _F, aligned: _F) -> None:
    """Do what `widened` says to variances (N, 3), in place."""
    for k in range(len(shapes)):
        missing = max(abs(aligned[k, 0] - shapes[k, 0]), abs(aligned[k, 1] - shapes[k, 1]))
        variances[k, 0] += 0.25 * missing**2
        variances[k, 1] += 0.25 * missing**2


@_compiled
def move_shapes(shapes: _F, aligned: _F, gains: _F) -> None:
    """Move shapes (N, 4) towards aligned ones by the gains (N,), in place."""
    for k in range(len(shapes)):
        for side in range(3):
            shapes[k, side] += gains[k] * (aligned[k, side] - shapes[k, side])
        turn = _wrapped(aligned[k, 3] - shapes[k, 3])
        shapes[k, 3] = _wrapped(shapes[k, 3] + gains[k] * turn)


@_compiled
def turn_shapes(
    shapes: _F, facing: _F, states: _F, covariances: _F, agreed: _Flags, elongated: _Flags
) -> None:
    """Do what `turn_to_course` says to shapes (N, 4) and votes (N,), in place."""
    for k in range(len(shapes)):
        moving = _is_moving(states[k], covariances[k])
        course = np.arctan2(states[k, 4], states[k, 3])
        if elongated[k] and _lies_across(shapes[k], course, moving):
            shapes[k, 0], shapes[k, 1] = shapes[k, 1], shapes[k, 0]
            shapes[k, 3] += _QUARTER_RAD
            votes = 0.0
        else:
            votes = facing[k] + (1.0 if agreed[k] else -1.0)
        along = np.cos(course - shapes[k, 3])
        if moving and abs(along) > _ALONG:
            votes += np.sign(along) * _COURSE_VOTE
        if votes < 0:
            shapes[k, 3] += np.pi
        shapes[k, 3] = _wrapped(shapes[k, 3])
        facing[k] = min(abs(votes), _MOST_FACING)


@_compiled
def _is_moving(state: _F, covariance: _F) -> bool:
    """Return whether a velocity is surely not zero."""
    spread = np.sqrt(max(covariance[3, 3], covariance[4, 4]))
    return bool(np.hypot(state[3], state[4]) > max(_COURSE_SIGMAS * spread, _COURSE_MPS))


@_compiled
def _lies_across(shape: _F, course: float, moving: bool) -> bool:  # noqa: FBT001  of a kernel
    """Return whether a box moves across its length, or is wider than long."""
    if moving:
        return bool(abs(np.cos(course - shape[3])) < _ACROSS)
    return bool(shape[1] > _WIDER * shape[0])


@_compiled
def _wrapped(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    return float(np.pi - (np.pi - angle_rad) % (2 * np.pi))
