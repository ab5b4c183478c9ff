"""The joint solution over the pairs that agree, and why the others are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.pairs import Sighting, pair_data
from percept.calib.camera_lidar.problem import (
    Common,
    PairData,
    Sigmas,
    linearise,
    moved_pose,
    residuals_of,
)
from percept.calib.camera_lidar.refine import Priors, Solution, reestimated, refine
from percept.calib.camera_lidar.seed import Seed
from percept.core.cameras import Camera

__all__ = ["Selection", "fits_better", "select_pairs"]

_F64 = NDArray[np.float64]

_START = Sigmas(corner_px=0.2, point_m=0.02, plane_m=0.005, outline_m=0.01, outline_rad=0.01)
_ROUNDS = 5
_POSE_STEPS = 5
# A pair is never called wrong for less than this, however well the others agree.
_LEAST_SHIFT_M = 0.02
_LEAST_TURN_RAD = float(np.radians(1.5))
_LEAST_CORNER_PX = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """Which pairs the result rests on.

    Attributes:
        data: What each sighting measured.
        rows: Rows of the used ones among the sightings.
        solution: Their joint minimum.
        reasons: By row of a sighting, why it is not used.
    """

    data: tuple[PairData, ...]
    rows: tuple[int, ...]
    solution: Solution
    reasons: dict[int, str]

    @property
    def used(self) -> list[PairData]:
        """What the used pairs measured."""
        return [self.data[k] for k in self.rows]


def select_pairs(
    sightings: Sequence[Sighting],
    seed: Seed,
    camera: Camera,
    priors: Priors,
    floor: Sigmas,
    reject_sigmas: float,
) -> Selection:
    """Solve for the pairs that agree, and leave out those that contradict the rest.

    Args:
        sightings: Pairs in which both sensors found the board.
        seed: The vote over them.
        camera: Intrinsics.
        priors: Of the common unknowns.
        floor: Smallest standard deviations.
        reject_sigmas: A pair that differs by more is left out.
    """
    data = tuple(
        pair_data(s, view, cloud, camera)
        for s, view, cloud in zip(sightings, seed.views, seed.clouds, strict=True)
    )
    rows = [k for k in range(len(data)) if seed.agreeing[k]] or [
        int(np.argmin(seed.centre_errors_m))
    ]
    reasons = {
        k: f"its boards in image and cloud lie {seed.centre_errors_m[k]:.2f} m apart by what "
        "the other pairs say"
        if seed.centre_errors_m[k] > _LEAST_SHIFT_M * 5
        else "its boards in image and cloud do not face the same way by what the other pairs say"
        for k in range(len(data))
        if k not in rows
    }
    common = Common(seed.T_camera_lidar)
    poses: dict[int, _F64] = {k: seed.views[k].T_camera_plate for k in rows}
    sigmas = _START
    for _ in range(_ROUNDS):
        used = [data[k] for k in rows]
        solution = refine(used, common, [poses[k] for k in rows], sigmas, priors)
        common, poses = solution.common, dict(zip(rows, solution.T_camera_plate, strict=True))
        before, sigmas = sigmas, reestimated(used, solution, floor)
        fresh = _contradicting(used, solution, sigmas, reject_sigmas)
        if len(rows) - len(fresh) < 3:
            fresh = {}
        reasons |= {rows[k]: reason for k, reason in fresh.items()}
        rows = [row for k, row in enumerate(rows) if k not in fresh]
        if not fresh and sigmas.close_to(before):
            break
    used = [data[k] for k in rows]
    solution = refine(used, common, [poses[k] for k in rows], sigmas, priors)
    return Selection(data, tuple(rows), solution, reasons)


def _contradicting(
    pairs: Sequence[PairData], solution: Solution, sigmas: Sigmas, reject_sigmas: float
) -> dict[int, str]:
    """Return by row why a pair contradicts the others."""
    found: dict[int, str] = {}
    for k, (pair, T) in enumerate(zip(pairs, solution.T_camera_plate, strict=True)):
        corners, points, outline = residuals_of(pair, solution.common, T)
        sd = np.sqrt(
            np.diag(pair.outline_covariance)
            + np.array([sigmas.outline_m, sigmas.outline_m, sigmas.outline_rad]) ** 2
        )
        plane_sd = float(np.hypot(sigmas.point_m / np.sqrt(len(points)), sigmas.plane_m))
        corner_px = float(np.sqrt(np.mean(corners**2)))
        middle_m = float(np.median(points))
        least = [_LEAST_SHIFT_M, _LEAST_SHIFT_M, _LEAST_TURN_RAD]
        off = np.abs(outline) > np.maximum(reject_sigmas * sd, least)
        if corner_px > max(reject_sigmas * sigmas.corner_px, _LEAST_CORNER_PX):
            found[k] = f"its corners fit the lens model to {corner_px:.1f} px only"
        elif abs(middle_m) > max(reject_sigmas * plane_sd, _LEAST_SHIFT_M):
            found[k] = f"its points lie {1000 * abs(middle_m):.0f} mm from the board's plane"
        elif off[:2].any():
            shift_mm = 1000 * float(np.hypot(*outline[:2]))
            found[k] = f"the board's outline in the cloud lies {shift_mm:.0f} mm from the image's"
        elif off[2]:
            found[k] = (
                f"the board in the cloud is turned by {np.degrees(abs(outline[2])):.1f} deg "
                "against the image's"
            )
    return found


def fits_better(selection: Selection, T_camera_lidar: _F64, start: Sequence[_F64]) -> bool:
    """Return whether another transform fits all sightings better than the solution.

    Args:
        selection: The pairs and their solution.
        T_camera_lidar: (4, 4) the other transform.
        start: (4, 4) T_camera_plate of every sighting to start from.
    """
    offset_m = selection.solution.common.range_offset_m
    own = _cost(selection, selection.solution.common, start)
    others = [_cost(selection, Common(T_camera_lidar, offset), start) for offset in (0.0, offset_m)]
    return min(others) < own * (1 - 1e-6)


def _cost(selection: Selection, common: Common, start: Sequence[_F64]) -> float:
    total = 0.0
    for pair, T in zip(selection.data, start, strict=True):
        pose = T
        for _ in range(_POSE_STEPS):
            block = linearise(pair, common, pose, selection.solution.sigmas)
            pose = moved_pose(pose, block.pose_right)
        total += linearise(pair, common, pose, selection.solution.sigmas).cost
    return total
