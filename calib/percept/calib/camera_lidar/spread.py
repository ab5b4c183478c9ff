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

from percept.calib.camera_lidar.problem import OFFSET, SCALE, PairData, pose_step
from percept.calib.camera_lidar.refine import Priors, Solution, refine

__all__ = ["Split", "full_covariance", "jackknife_covariance", "leave_one_out", "split_in_halves"]

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
    """Return (P, 13) how the common unknowns move when each of three or more pairs is left out.

    One Gauss-Newton step from the minimum, which is exact as far as the problem is linear: the
    other pairs' blocks stay what they are.
    """
    H = solution.prior + sum(b.common for b in solution.blocks)
    return np.array([np.linalg.solve(H - b.common, -b.right) for b in solution.blocks])


def jackknife_covariance(solution: Solution) -> _F64:
    """Return (13, 13) the covariance of the common unknowns from leaving pairs out.

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


def full_covariance(solution: Solution, given: Priors, drift: _F64 | None = None) -> _F64:
    """Return (7, 7) the covariance of transform and range offset with all that was held in it.

    The solution holds the board's size, the intrinsics and the pattern's place on the plate. With
    S the shift of the solution by an error of those, and m, P the mean and covariance that the
    data and what is known of them leave of that error, it is off by S (m m^T + P) S^T more.

    Args:
        solution: The minimum with them held.
        given: How well they are known beforehand.
        drift: (6,) from the transform of the first half of the pairs to that of the second. Two
            values that differ by d leave their mean with a standard deviation of d / 2 at least
            (Birge 1932), also where leaving out single pairs does not show it.
    """
    kept, held = slice(0, SCALE), slice(SCALE, None)
    found = jackknife_covariance(solution)[kept, kept]
    stated = solution.covariance()[kept, kept]
    # The normal equations say too much; by as much as leaving pairs out says less.
    tempered = max(float(np.mean(np.diag(found)[:OFFSET] / np.diag(stated)[:OFFSET])), 1.0)
    H = np.sum([b.common for b in solution.blocks], axis=0) / tempered
    right = np.sum([b.right for b in solution.blocks], axis=0) / tempered
    H_kept = H[kept, kept] + solution.prior[kept, kept]
    S = -np.linalg.solve(H_kept, H[kept, held])
    prior, _, _ = given.normal_equations(solution.common)
    P = np.linalg.inv(H[held, held] + H[held, kept] @ S + prior[held, held])
    m = P @ right[held]
    total = found + S @ (np.outer(m, m) + P) @ S.T
    sd = np.sqrt(np.diag(total))
    least = np.zeros(len(sd))
    if drift is not None:
        least[:6] = np.abs(drift) / 2
    grow = np.maximum(least / sd, 1.0)
    widened: _F64 = total * np.outer(grow, grow)
    return widened


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
        covariance: (7, 7) or larger, of the common unknowns from all pairs.

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
