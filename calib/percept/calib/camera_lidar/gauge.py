"""What the LiDAR, as a ruler, says about the board's size and the camera's intrinsics.

All is given and held in the solution. Here it goes free, one after the other: a wrong square, a
wrong lens or a pattern beside the plate's middle then shows as a number with a standard deviation
instead of as a shifted transform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.problem import CENTRE, FOCAL, PATTERN, SCALE, PairData
from percept.calib.camera_lidar.refine import Priors, Solution, refine
from percept.calib.camera_lidar.result import Estimate
from percept.calib.camera_lidar.spread import jackknife_covariance
from percept.calib.limits import CameraLidarLimits

__all__ = ["Gauge", "measure_gauge"]

_F64 = NDArray[np.float64]

_FREE = 0.3
_UNKNOWN_MORE = 2
"""Other intrinsics are three unknowns, another board size is one (Akaike 1974)."""


@dataclass(frozen=True, slots=True)
class Gauge:
    """Given sizes as the LiDAR sees them.

    Attributes:
        board_scale: Size of the printed pattern over the given one, intrinsics held.
        focal_scale: Focal length over the given one, the board held.
        centre_off_deg: Angle by which the principal point is off, to the right and down.
        pattern_off_m: How far the pattern lies off the plate's middle, along columns and rows.
        lens_fits_better: Whether other intrinsics explain the data better than another board.
    """

    board_scale: Estimate
    focal_scale: Estimate
    centre_off_deg: tuple[Estimate, Estimate]
    pattern_off_m: tuple[Estimate, Estimate]
    lens_fits_better: bool


def measure_gauge(
    pairs: Sequence[PairData], solution: Solution, priors: Priors, given: Priors
) -> Gauge:
    """Let the board's size, then the intrinsics, then the pattern's place on the plate go free.

    Args:
        pairs: What was measured.
        solution: The minimum with both held.
        priors: Of that minimum.
        given: How well the intrinsics and the board's size are known. The pattern's place is
            measured with them as loose as that, since a slightly wrong lens looks like it.
    """
    board = _freed(pairs, solution, replace(priors, board_scale=_FREE))
    lens = _freed(pairs, solution, replace(priors, focal_scale=_FREE, centre_xy=_FREE))
    printed = _freed(pairs, solution, replace(given, pattern_m=_FREE))
    board_sd, lens_sd, printed_sd = (
        np.sqrt(np.diag(jackknife_covariance(s))) for s in (board, lens, printed)
    )
    ruler_m = CameraLidarLimits().range_systematic_m
    centres = np.array(solution.T_camera_plate)[:, :3, 3]
    apart_m = float(np.linalg.norm(np.ptp(centres, axis=0)))
    deeper_m = float(np.ptp(np.linalg.norm(centres, axis=1)))
    off_deg = np.degrees(lens.common.centre_xy)
    off_sd = np.degrees(lens_sd[CENTRE])
    x_off, y_off = printed.common.pattern_m
    x_sd, y_sd = printed_sd[PATTERN]
    return Gauge(
        board_scale=Estimate(
            board.common.board_scale, float(np.hypot(board_sd[SCALE], ruler_m / max(apart_m, 1e-6)))
        ),
        focal_scale=Estimate(
            lens.common.focal_scale, float(np.hypot(lens_sd[FOCAL], ruler_m / max(deeper_m, 1e-6)))
        ),
        centre_off_deg=(
            Estimate(float(off_deg[0]), float(off_sd[0])),
            Estimate(float(off_deg[1]), float(off_sd[1])),
        ),
        pattern_off_m=(Estimate(x_off, float(x_sd)), Estimate(y_off, float(y_sd))),
        lens_fits_better=lens.cost + 2 * _UNKNOWN_MORE < board.cost,
    )


def _freed(pairs: Sequence[PairData], solution: Solution, priors: Priors) -> Solution:
    return refine(pairs, solution.common, solution.T_camera_plate, solution.sigmas, priors)
