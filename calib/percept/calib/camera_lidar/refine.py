"""Gauss-Newton over all pairs at once, with damping, and standard deviations from the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.problem import (
    CENTRE,
    COMMON,
    FOCAL,
    OFFSET,
    PATTERN,
    SCALE,
    Block,
    Common,
    PairData,
    Sigmas,
    linearise,
    moved_pose,
    residuals_of,
)

__all__ = ["Priors", "Solution", "reestimated", "refine"]

_F64 = NDArray[np.float64]

_ITERATIONS = 30
_LARGEST_DAMPING = 1e6
_STILL = 1e-7
_FEWEST_FOR_SPREAD = 4
_NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
_HALVINGS = 20


@dataclass(frozen=True, slots=True)
class Priors:
    """Standard deviations of the common unknowns about their nominal values.

    Attributes:
        range_offset_m: About 0.
        board_scale, focal_scale: About 1; the default holds them there.
        centre_xy: About 0, in focal lengths; the default holds it there.
        pattern_m: About 0; the default holds it there.
    """

    range_offset_m: float = 0.02
    board_scale: float = 1e-9
    focal_scale: float = 1e-9
    centre_xy: float = 1e-9
    pattern_m: float = 1e-9

    def normal_equations(self, common: Common) -> tuple[_F64, _F64, float]:
        """Return their matrix (13, 13), right-hand side (13,) and cost."""
        off, sd = np.zeros(COMMON), np.full(COMMON, np.inf)
        off[[OFFSET, SCALE, FOCAL]] = (
            common.range_offset_m,
            common.board_scale - 1,
            common.focal_scale - 1,
        )
        off[CENTRE], off[PATTERN] = common.centre_xy, common.pattern_m
        sd[[OFFSET, SCALE, FOCAL]] = self.range_offset_m, self.board_scale, self.focal_scale
        sd[CENTRE], sd[PATTERN] = self.centre_xy, self.pattern_m
        return np.diag(sd**-2.0), -off / sd**2, float(np.sum((off / sd) ** 2))


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The minimum.

    Attributes:
        common: Unknowns that all pairs share.
        T_camera_plate: For each pair (4, 4).
        blocks: Normal equations of each pair at the minimum.
        prior: (13, 13) normal matrix of the priors.
        cost: Robust cost, priors included.
        sigmas: What the residuals were weighed with.
    """

    common: Common
    T_camera_plate: tuple[_F64, ...]
    blocks: tuple[Block, ...]
    prior: _F64
    cost: float
    sigmas: Sigmas

    def covariance(self) -> _F64:
        """Return (13, 13) the covariance that the normal equations state."""
        total = self.prior + sum(b.common for b in self.blocks)
        return np.asarray(np.linalg.inv(total), dtype=np.float64)


def refine(
    pairs: Sequence[PairData],
    start: Common,
    poses: Sequence[_F64],
    sigmas: Sigmas,
    priors: Priors | None = None,
) -> Solution:
    """Minimise the robust cost over all unknowns (Levenberg 1944, with exact elimination).

    Args:
        pairs: What was measured; at least one.
        start: Common unknowns to start from.
        poses: (4, 4) T_camera_plate of each pair to start from.
        sigmas: Standard deviations of what was measured.
        priors: Of the common unknowns.
    """
    priors = priors or Priors()
    current = _evaluate(pairs, start, poses, sigmas, priors)
    damping = 1e-6
    for _ in range(_ITERATIONS):
        step = _step(current, priors, damping)
        moved = [
            moved_pose(T, b.pose_right - b.pose_solve @ step)
            for T, b in zip(current.T_camera_plate, current.blocks, strict=True)
        ]
        trial = _evaluate(pairs, current.common.moved(step), moved, sigmas, priors)
        if trial.cost <= current.cost:
            gain = current.cost - trial.cost
            current, damping = trial, max(damping / 10, 1e-9)
            if np.abs(step).max() < _STILL or gain < _STILL * (1e-3 + current.cost):
                break
        else:
            damping *= 10
            if damping > _LARGEST_DAMPING:
                break
    return current


def _evaluate(
    pairs: Sequence[PairData],
    common: Common,
    poses: Sequence[_F64],
    sigmas: Sigmas,
    priors: Priors,
) -> Solution:
    blocks = tuple(linearise(p, common, T, sigmas) for p, T in zip(pairs, poses, strict=True))
    prior, _, prior_cost = priors.normal_equations(common)
    cost = prior_cost + sum(b.cost for b in blocks)
    return Solution(common, tuple(poses), blocks, prior, cost, sigmas)


def _step(current: Solution, priors: Priors, damping: float) -> _F64:
    prior, right, _ = priors.normal_equations(current.common)
    H = prior + sum(b.common for b in current.blocks)
    step = np.linalg.solve(
        H + damping * np.diag(np.diag(H)), right + sum(b.right for b in current.blocks)
    )
    return np.asarray(step, dtype=np.float64)


def reestimated(pairs: Sequence[PairData], solution: Solution, floor: Sigmas) -> Sigmas:
    """Return the standard deviations that the residuals show.

    Robust: from the median of the absolute residuals. What the points of a plate, or the two
    coordinates of an outline, have in common from pair to pair is estimated as the spread that
    their own noise does not explain (Paule and Mandel 1982, in robust form).

    Args:
        pairs: What was measured.
        solution: The minimum.
        floor: No standard deviation gets smaller than these.
    """
    plain = [
        residuals_of(p, solution.common, T)
        for p, T in zip(pairs, solution.T_camera_plate, strict=True)
    ]
    corners = np.concatenate([r[0] for r in plain])
    freedom = max(len(corners) - 6 * len(pairs), 1) / len(corners)
    point_m = max(_spread(np.concatenate([r[1] - np.median(r[1]) for r in plain])), floor.point_m)
    means = np.array([np.mean(np.clip(r[1], -0.2, 0.2)) for r in plain])
    own = np.array([point_m**2 / len(r[1]) for r in plain])
    outline = np.array([r[2] for r in plain])
    known = np.array([np.diag(p.outline_covariance) for p in pairs])
    return Sigmas(
        corner_px=max(_spread(corners) / np.sqrt(freedom), floor.corner_px),
        point_m=point_m,
        plane_m=max(_beyond(means, own), floor.plane_m),
        outline_m=max(_beyond(outline[:, :2].ravel(), known[:, :2].ravel()), floor.outline_m),
        outline_rad=max(_beyond(outline[:, 2], known[:, 2]), floor.outline_rad),
    )


def _spread(values: _F64) -> float:
    return float(1.4826 * np.median(np.abs(values)))


def _beyond(values: _F64, known_variance: _F64) -> float:
    """Return the standard deviation of values (K,) that known variances (K,) do not explain."""
    if len(values) < _FEWEST_FOR_SPREAD:
        return 0.0
    low, high = 0.0, float(np.abs(values).max()) * 2
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        normalised = np.abs(values) / np.sqrt(known_variance + middle**2)
        low, high = (middle, high) if np.median(normalised) > _NORMAL_MEDIAN else (low, middle)
    return high
