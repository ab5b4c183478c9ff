"""How far a camera-LiDAR transform would move with other pairs.

What the normal equations state is 5 to 10 times too small on real data, since the errors of one
board are not independent. So pairs are left out one at a time (jackknife; Efron and Stein 1981),
and the pairs are split in halves that are solved for themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar_problem import PairData, pose_step
from percept.calib.camera_lidar_refine import Solution, refine

__all__ = ["Split", "jackknife_covariance", "leave_one_out", "split_in_halves"]

_F64 = NDArray[np.float64]

_FEWEST_IN_HALF = 3


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Two halves of the pairs, solved apart.

    Attributes:
        step: (6,) rotation vector in rad and shift in metres from the first half's transform to
            the second's, in the camera's axes.
        z: (6,) that step in standard deviations of the difference of two halves.
        gain: By how much two transforms explain the pairs better than one: chi squared.
    """

    step: _F64
    z: _F64
    gain: float

    @property
    def rotation_deg(self) -> float:
        """Angle between the halves."""
        return float(np.degrees(np.linalg.norm(self.step[:3])))

    @property
    def translation_m(self) -> float:
        """Distance between the LiDAR's origins, in the camera's frame."""
        return float(np.linalg.norm(self.step[3:]))


def leave_one_out(solution: Solution) -> _F64:
    """Return (P, 11) how the common unknowns move when each of three or more pairs is left out.

    One Gauss-Newton step from the minimum, which is exact as far as the problem is linear: the
    other pairs' blocks stay what they are.
    """
    H = solution.prior + sum(b.common for b in solution.blocks)
    return np.array([np.linalg.solve(H - b.common, -b.right) for b in solution.blocks])


def jackknife_covariance(solution: Solution) -> _F64:
    """Return (11, 11) the covariance of the common unknowns from leaving pairs out.

    It is never smaller, in any one unknown, than what the normal equations state: few pairs
    that agree by chance would make it so.
    """
    stated = solution.covariance()
    count = len(solution.blocks)
    if count < _FEWEST_IN_HALF:
        return stated
    moves = leave_one_out(solution)
    away = moves - moves.mean(axis=0)
    found = away.T @ away * (count - 1) / count
    grow = np.sqrt(np.maximum(np.diag(stated) / np.maximum(np.diag(found), 1e-300), 1.0))
    # Scaled as a correlation, so that the matrix stays positive.
    scaled: _F64 = found * np.outer(grow, grow)
    return scaled


def split_in_halves(
    pairs: Sequence[PairData],
    solution: Solution,
    second: NDArray[np.bool_],
    covariance: _F64,
) -> Split | None:
    """Solve two halves of the pairs apart.

    Args:
        pairs: All pairs.
        solution: Their common minimum, from which both halves start.
        second: (P,) which pairs make the second half.
        covariance: (11, 11) of the common unknowns from all pairs.

    Returns:
        The difference, or None where a half has fewer than three pairs.
    """
    if min(second.sum(), (~second).sum()) < _FEWEST_IN_HALF:
        return None
    first, second_half = (_solved(pairs, solution, half) for half in (~second, second))
    step = pose_step(first.common.T_camera_lidar, second_half.common.T_camera_lidar)
    share = second.mean()
    sd = np.sqrt(np.diag(covariance)[:6] * (1 / share + 1 / (1 - share)))
    gain = solution.cost - first.cost - second_half.cost
    return Split(step, step / np.maximum(sd, 1e-12), gain)


def _solved(pairs: Sequence[PairData], solution: Solution, half: NDArray[np.bool_]) -> Solution:
    rows = np.flatnonzero(half).tolist()
    return refine(
        [pairs[k] for k in rows],
        solution.common,
        [solution.T_camera_plate[k] for k in rows],
        solution.sigmas,
    )
