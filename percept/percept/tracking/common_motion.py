"""How the whole scene moves past a sensor whose own motion is not known.

Without poses the frame of the detections moves with the vehicle. What stands still then moves
as one rigid body: with the velocity ``v(x, y) = t + w (-y, x)``, where t and w are the
vehicle's velocity and turn rate reversed. They are estimated from the tracks that there are, and
a new track begins with the velocity of the scene at its place instead of none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.tracking.track_table import TrackTable

__all__ = ["CommonMotion", "common_motion"]

_F64 = NDArray[np.float64]

_LENIENCE = (100.0, 10.0, 1.0)
"""Variances of each round in those of the last one, so that the first sees all objects."""
_OWN_SPEED_MPS = 1.0
"""Objects that move by more than a few of these against the rest count little."""
_PRIOR_SD = np.array([10.0, 10.0, 0.3])
"""Speeds in m/s and turn rate in rad/s that vehicles have."""


@dataclass(frozen=True, slots=True, eq=False)
class CommonMotion:
    """An estimate of t and w.

    Attributes:
        mean: (3,) float64 t in m/s, and w in rad/s.
        covariance: (3, 3) float64.
    """

    mean: _F64
    covariance: _F64

    def at(self, positions_m: _F64) -> tuple[_F64, _F64]:
        """Return the velocities (N, 2) at positions (N, 2), and their covariances (N, 2, 2)."""
        design = _design(positions_m)
        return design @ self.mean, design @ self.covariance @ design.transpose(0, 2, 1)


def common_motion(tracks: TrackTable) -> CommonMotion:
    """Return the motion that most tracks share, by iterated reweighting.

    The weights are those of Geman and McClure (1985): what moves by itself hardly counts. They
    become strict over the rounds, so that the start does not decide who the majority is.
    Without tracks the estimate is what is known of vehicles.
    """
    prior = np.diag(_PRIOR_SD**-2)
    mean, covariance = np.zeros(3), np.diag(_PRIOR_SD**2)
    if not len(tracks):
        return CommonMotion(mean, covariance)
    design = _design(tracks["state"][:, :2]).reshape(-1, 3)
    velocities = tracks["state"][:, 3:5].reshape(-1)
    spread = tracks["covariance"][:, (3, 4), (3, 4)].mean(axis=1)
    variances = _OWN_SPEED_MPS**2 + spread
    squared = np.zeros(len(tracks))
    for lenience in _LENIENCE:
        weights = np.repeat(1 / ((1 + squared / lenience) ** 2 * variances), 2)
        weighted = design * weights[:, None]
        covariance = np.linalg.inv(prior + weighted.T @ design)
        mean = covariance @ (weighted.T @ velocities)
        squared = ((velocities - design @ mean).reshape(-1, 2) ** 2).sum(axis=1) / variances
    return CommonMotion(mean, covariance)


def _design(positions_m: _F64) -> _F64:
    """Return the (N, 2, 3) matrices that make velocities of t and w."""
    design = np.zeros((len(positions_m), 2, 3))
    design[:, 0, 0] = design[:, 1, 1] = 1.0
    design[:, 0, 2], design[:, 1, 2] = -positions_m[:, 1], positions_m[:, 0]
    return design
