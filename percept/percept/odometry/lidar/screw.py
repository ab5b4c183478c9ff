"""A part of a rigid motion: what of it has happened after a share of its time.

The motion between two poses is taken as a screw: turn rate and velocity are constant in the
moving frame (Lynch and Park 2017, section 3.3.3), as KISS-ICP assumes between two scans.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

__all__ = ["inverse_motion", "part_of_motion"]

_SMALL_RAD = 1e-6


def part_of_motion(motion: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return the motion (4, 4) after a share of its time; more than 1 goes on, below 0 goes back.

    Args:
        motion: (4, 4) float64 rigid transform.
        share: Of the time that the motion takes.
    """
    turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
    velocity = np.linalg.solve(_left_jacobian(turn), motion[:3, 3])
    part = np.eye(4)
    part[:3, :3] = Rotation.from_rotvec(share * turn).as_matrix()
    part[:3, 3] = _left_jacobian(share * turn) @ (share * velocity)
    return part


def inverse_motion(motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse (4, 4) of a rigid transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = motion[:3, :3].T
    inverse[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return inverse


def _left_jacobian(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return G(theta) (3, 3) of Lynch and Park 2017, equation (3.91), for a rotation vector."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn.tolist()
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])
    if angle < _SMALL_RAD:
        return np.eye(3) + 0.5 * cross
    first = (1 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    jacobian: NDArray[np.float64] = np.eye(3) + first * cross + second * cross @ cross
    return jacobian
