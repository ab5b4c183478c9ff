"""Where a camera sits as seen from a LiDAR, by boards in new pairs alone, with controls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.calibrate import (
    CameraLidarCalibrationConfig,
    calibrate_camera_lidar,
)
from percept.calib.camera_lidar.pairs import BoardPair
from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.calib.check.axes import base_sd, plant_controls, reversed_measurement
from percept.calib.check.result import Control, IntrinsicsCheck, Measurement
from percept.calib.limits import CameraLidarLimits, CheckLimits
from percept.core.cameras import Camera
from percept.core.results import Verdict

if TYPE_CHECKING:
    from percept.calib.boards.definitions import Board

__all__ = ["CameraBoards", "measure_camera"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraBoards:
    """Pairs that show a board to a camera and a LiDAR of the rig.

    Attributes:
        camera: Name of the camera.
        lidar: Name of the LiDAR.
        model: The camera's intrinsics by the rig.
        pairs: What both saw.
        board: What is printed on the board.
        plate_size_m: (width, height) of the plate.
    """

    camera: str
    lidar: str
    model: Camera
    pairs: Sequence[BoardPair]
    board: Board
    plate_size_m: tuple[float, float]


def measure_camera(
    boards: CameraBoards,
    T_base_lidar: _F64,
    config: CameraLidarCalibrationConfig,
    limits: CheckLimits,
) -> tuple[Measurement, IntrinsicsCheck | None, CameraLidarCalibration]:
    """Calibrate the camera and the LiDAR anew, without the rig, and say what that rests on.

    Args:
        boards: The pairs.
        T_base_lidar: (4, 4) by the rig.
        config: Settings of the solver.
        limits: The limits.

    Returns:
        The place of the camera, its intrinsics, and the calibration; no intrinsics where no
        image shows the board.

    Raises:
        UsageError: If the pattern does not fit on the plate.
    """
    whole = _solve(boards, boards.pairs, config)
    intrinsics = _intrinsics(boards.camera, whole, limits)
    used = [p for p, r in zip(boards.pairs, whole.pairs, strict=True) if r.used]
    found = _measurement(boards, whole, len(used))
    if found is None:
        return _nothing(boards, whole), intrinsics, whole
    controls = _controls(boards, used, found, T_base_lidar, config, limits)
    measured = Measurement(
        against=boards.lidar,
        sensor=boards.camera,
        T_against_sensor=found.T_against_sensor,
        covariance=found.covariance,
        controls=controls,
        kind="camera",
        scenes=len(used),
        confirmed=len(used) >= CameraLidarLimits().fewest_pairs_good,
        verdict=whole.verdict,
        why=whole.why,
    )
    return measured, intrinsics, whole


def _solve(
    boards: CameraBoards, pairs: Sequence[BoardPair], config: CameraLidarCalibrationConfig
) -> CameraLidarCalibration:
    return calibrate_camera_lidar(pairs, boards.model, boards.board, boards.plate_size_m, config)


def _measurement(
    boards: CameraBoards, found: CameraLidarCalibration, used: int
) -> Measurement | None:
    """Return the camera as seen from the LiDAR; None where the pairs do not decide it."""
    usable = found.verdict in (Verdict.GOOD, Verdict.DOUBTFUL)
    if not usable or found.T_camera_lidar is None or found.covariance is None:
        return None
    return reversed_measurement(
        Measurement(
            against=boards.camera,
            sensor=boards.lidar,
            T_against_sensor=found.T_camera_lidar,
            covariance=found.covariance,
            controls={},
            kind="camera",
            scenes=used,
            confirmed=False,
            verdict=found.verdict,
            why=found.why,
        )
    )


def _controls(
    boards: CameraBoards,
    used: Sequence[BoardPair],
    found: Measurement,
    T_base_lidar: _F64,
    config: CameraLidarCalibrationConfig,
    limits: CheckLimits,
) -> dict[str, Control]:
    """Plant shifts at the place by one half of the pairs and look for them in the other.

    The solver starts from nothing, so that it gives the same answer whatever was planted.
    """
    halves = [used[0::2], used[1::2]]
    solved = []
    if min(map(len, halves)) >= CameraLidarLimits().fewest_pairs_doubtful:
        results = [_solve(boards, half, config) for half in halves]
        solved = [_measurement(boards, one, 0) for one in results]
    parts = [one for one in solved if one is not None]
    held_out = len(parts) == 2
    if not held_out:
        parts = [found]
    places = [one.T_against_sensor for one in parts if one.T_against_sensor is not None]
    folds = [
        (T_other, partial(_leads_to, T_own))
        for T_own, T_other in zip(places, places[::-1], strict=True)
    ]
    sd = base_sd(T_base_lidar, found.covariance)
    return plant_controls("camera", T_base_lidar, sd, folds, limits, held_out=held_out)


def _leads_to(T_end: _F64, _T_start: _F64) -> _F64:
    """Stand for a solver that does not care where it starts."""
    return T_end


def _intrinsics(
    camera: str, found: CameraLidarCalibration, limits: CheckLimits
) -> IntrinsicsCheck | None:
    """Compare the boards' corners with what the rig's intrinsics make of each board."""
    if found.corner_rms_px is None or not np.isfinite(found.corner_rms_px):
        return None
    focal = found.focal_scale
    scale, scale_sd = (np.nan, np.nan) if focal is None else (focal.value, focal.sd)
    off = abs(scale - 1)
    problems = []
    if found.corner_rms_px > limits.reprojection_px:
        problems.append(f"corners miss their own board by {found.corner_rms_px:.2f} px")
    if off > limits.focal_share and off > limits.focal_sd * scale_sd:
        problems.append(f"the focal length is off by {scale - 1:+.1%} by the LiDAR")
    return IntrinsicsCheck(
        camera=camera,
        reprojection_px=float(found.corner_rms_px),
        focal_scale=float(scale),
        focal_scale_sd=float(scale_sd),
        verdict=Verdict.BAD if problems else Verdict.GOOD,
        why="; ".join(problems) or f"corners fit their boards to {found.corner_rms_px:.2f} px",
    )


def _nothing(boards: CameraBoards, found: CameraLidarCalibration) -> Measurement:
    ambiguous = found.verdict is Verdict.AMBIGUOUS
    return Measurement(
        against=boards.lidar,
        sensor=boards.camera,
        T_against_sensor=None,
        covariance=np.full((6, 6), np.inf),
        controls={},
        kind="camera",
        scenes=sum(pair.used for pair in found.pairs),
        confirmed=False,
        verdict=Verdict.AMBIGUOUS if ambiguous else Verdict.BAD,
        why=tuple(f"{reason}." for reason in found.why),
    )
