"""The Kalman update from measured centres, and the filters of size and yaw beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "aligned_shapes",
    "turn_to_course",
    "update_positions",
    "update_shapes",
    "widened",
    "wrap_angle",
]

_F64 = NDArray[np.float64]


def update_positions(
    states: _F64, covariances: _F64, centres_m: _F64, variances_m2: _F64
) -> tuple[_F64, _F64]:
    """Return the states and covariances after a measurement of each centre.

    The covariance takes Joseph's form, which stays symmetric and positive whatever the rounding.

    Args:
        states: (N, 6) predicted means.
        covariances: (N, 6, 6) of the same.
        centres_m: (N, 3) measured x, y, z.
        variances_m2: (N, 3) of their errors.
    """
    from percept.tracking.filter_kernels import update_in_place

    updated, spreads = states.copy(), covariances.copy()
    update_in_place(updated, spreads, centres_m, variances_m2)
    return updated, spreads


def aligned_shapes(shapes: _F64, measured: _F64) -> tuple[_F64, NDArray[np.bool_]]:
    """Name the sides of measured boxes as their tracks do.

    A box is the same when it is turned by a half, and when it is turned by a quarter and its
    length and width change places. A box around an L of points does not know which of these is
    the front. The turn is taken that comes closest to the track in yaw and size.

    Args:
        shapes: (N, 4) length, width, height, yaw of the tracks.
        measured: (N, 4) of their detections.

    Returns:
        (N, 4) the measured boxes, renamed, and (N,) whether the front stayed where it was.
    """
    from percept.tracking.filter_kernels import align_shapes

    aligned, agreed = np.empty_like(measured), np.empty(len(measured), np.bool_)
    align_shapes(shapes, measured, aligned, agreed)
    return aligned, agreed


def widened(variances_m2: _F64, shapes: _F64, aligned: _F64) -> _F64:
    """Return the variances (N, 3) of centres, larger where a box shows another size than its track.

    A box around a part of an object has its centre up to half of the missing length beside it.
    """
    from percept.tracking.filter_kernels import widen

    wide = variances_m2.copy()
    widen(wide, shapes, aligned)
    return wide


def update_shapes(shapes: _F64, aligned: _F64, gains: _F64) -> _F64:
    """Return the (N, 4) shapes moved towards aligned measurements by the gains (N,)."""
    from percept.tracking.filter_kernels import move_shapes

    moved = shapes.copy()
    move_shapes(moved, aligned, gains)
    return moved


def turn_to_course(
    shapes: _F64,
    facing: _F64,
    states: _F64,
    covariances: _F64,
    agreed: NDArray[np.bool_],
    elongated: NDArray[np.bool_],
) -> tuple[_F64, _F64]:
    """Turn boxes whose front is not in front: by a quarter, by a half.

    What is elongated and moves across its length, or has become wider than long, had its sides
    confused: a car seen from behind shows its width only. What goes backwards, or is mostly
    detected the other way round, is turned by a half. Surely moving objects decide this by
    their course; where the detector has no idea of a front, it is soon outvoted.

    Args:
        shapes: (N, 4) length, width, height, yaw.
        facing: (N,) votes so far for the direction of the yaw.
        states: (N, 6) with the velocities.
        covariances: (N, 6, 6).
        agreed: (N,) whether the new detection pointed the same way.
        elongated: (N,) whether the class is longer than wide and moves along its length.

    Returns:
        The shapes and the votes, which are never negative afterwards.
    """
    from percept.tracking.filter_kernels import turn_shapes

    turned, votes = shapes.copy(), facing.copy()
    turn_shapes(turned, votes, states, covariances, agreed, elongated)
    return turned, votes


def wrap_angle(angles_rad: _F64) -> _F64:
    """Return the angles in (-pi, pi]."""
    wrapped: _F64 = np.pi - np.mod(np.pi - angles_rad, 2 * np.pi)
    return wrapped
