"""Where a camera sits relative to a LiDAR, from a board that both see, without a guess.

Every image gives the poses of the plate that explain its corners (PnP), every cloud those that
explain the points; a vote over the pairs finds the transform that most of them share; one joint
robust refinement of the transform, the plates and a range offset follows; pairs that contradict
it are left out with a reason; and the spread comes from leaving pairs out and from halves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.calib.camera_lidar.degeneracy import board_spread
from percept.calib.camera_lidar.gauge import measure_gauge
from percept.calib.camera_lidar.pairs import (
    BoardPair,
    Sighting,
    check_plate,
    pair_result,
    sightings_of,
)
from percept.calib.camera_lidar.problem import OFFSET, Sigmas, residuals_of
from percept.calib.camera_lidar.refine import Priors
from percept.calib.camera_lidar.result import CameraLidarCalibration, Estimate, PairResult
from percept.calib.camera_lidar.seed import Seed, seed_rig
from percept.calib.camera_lidar.select import Selection, fits_better, select_pairs
from percept.calib.camera_lidar.spread import (
    Split,
    full_covariance,
    jackknife_covariance,
    leave_one_out,
    split_in_halves,
)
from percept.calib.camera_lidar.suspects import likely_mistake, partner_of
from percept.calib.camera_lidar.verdict import Facts, judge
from percept.calib.limits import CameraLidarLimits
from percept.core.cameras import Camera
from percept.core.results import Verdict
from percept.core.settings import Settings

if TYPE_CHECKING:
    from percept.calib.boards.definitions import Board

__all__ = ["BoardPair", "CameraLidarCalibrationConfig", "calibrate_camera_lidar"]

_F64 = NDArray[np.float64]

_SQUARE_PLATE = 0.05
_ODD_EVEN = "every second pair and the others"
_FIRST_SECOND = "the first half of the pairs and the second"


class CameraLidarCalibrationConfig(Settings):
    """Settings of the camera-LiDAR calibration.

    Attributes:
        corner_sd_px: Smallest standard deviation of a corner; it is estimated from the residuals.
        point_sd_m: Smallest standard deviation of a point along the board's normal.
        outline_sd_m: Smallest error of the outline's place that two boards do not share.
        range_offset_sd_m: How far the LiDAR's ranges may be off as a whole.
        board_scale_sd: How far the printed pattern may be off in size, as a share,
        focal_scale_sd: and the focal length,
        centre_sd_deg: and the principal point, as an angle,
        pattern_sd_m: and the pattern from the plate's middle. The result holds what is given, and
            its standard deviations contain what an error of this size does to it.
        reject_sigmas: A pair that differs from the others by more is left out.
    """

    corner_sd_px: float = Field(default=0.05, gt=0, le=5)
    point_sd_m: float = Field(default=0.003, gt=0, le=0.1)
    outline_sd_m: float = Field(default=0.001, gt=0, le=0.1)
    range_offset_sd_m: float = Field(default=0.02, gt=0, le=1)
    board_scale_sd: float = Field(default=0.001, ge=1e-9, le=0.1)
    focal_scale_sd: float = Field(default=0.005, ge=1e-9, le=0.1)
    centre_sd_deg: float = Field(default=0.1, ge=1e-6, le=5)
    pattern_sd_m: float = Field(default=0.003, ge=1e-9, le=0.1)
    reject_sigmas: float = Field(default=4.0, ge=2, le=100)

    def given(self) -> Priors:
        """Return how well what the solution holds is known."""
        return Priors(
            range_offset_m=self.range_offset_sd_m,
            board_scale=self.board_scale_sd,
            focal_scale=self.focal_scale_sd,
            centre_xy=float(np.radians(self.centre_sd_deg)),
            pattern_m=self.pattern_sd_m,
        )

    def floor(self) -> Sigmas:
        """Return the smallest standard deviations."""
        return Sigmas(
            corner_px=self.corner_sd_px,
            point_m=self.point_sd_m,
            plane_m=self.outline_sd_m / 2,
            outline_m=self.outline_sd_m,
            outline_rad=self.outline_sd_m,
        )


def calibrate_camera_lidar(
    pairs: Sequence[BoardPair],
    camera: Camera,
    board: Board,
    plate_size_m: tuple[float, float],
    config: CameraLidarCalibrationConfig | None = None,
    initial: _F64 | None = None,
) -> CameraLidarCalibration:
    """Find the transform between a camera and a LiDAR from pairs that show one board.

    Args:
        pairs: Images and clouds of the board in different poses, in the order of their capture.
        camera: Intrinsics.
        board: What is printed on the board.
        plate_size_m: (width, height) of the plate, along the columns and the rows.
        config: Settings.
        initial: (4, 4) an earlier T_camera_lidar; never needed and not started from. A result
            that fits the pairs worse than it does is not called good.

    Returns:
        The calibration, with its verdict; without a transform where no pair can be used.

    Raises:
        UsageError: If the pattern does not fit on the plate.
    """
    config = config or CameraLidarCalibrationConfig()
    corners = board.corners_board()
    check_plate(corners, plate_size_m)
    square = abs(plate_size_m[0] / plate_size_m[1] - 1) < _SQUARE_PLATE
    sightings, reasons = sightings_of(pairs, camera, corners)
    if not sightings:
        return _nothing(pairs, reasons)
    seed = seed_rig(
        [s.views for s in sightings], [s.clouds for s in sightings], square_plate=square
    )
    priors = Priors(range_offset_m=config.range_offset_sd_m)
    selection = select_pairs(sightings, seed, camera, priors, config.floor(), config.reject_sigmas)
    return _conclude(
        _Run(pairs, sightings, reasons, camera, plate_size_m, seed, selection, config, square),
        initial,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """All that the conclusion rests on."""

    pairs: Sequence[BoardPair]
    sightings: Sequence[Sighting]
    reasons: dict[int, str]
    camera: Camera
    plate_size_m: tuple[float, float]
    seed: Seed
    selection: Selection
    config: CameraLidarCalibrationConfig
    square_plate: bool

    @property
    def priors(self) -> Priors:
        """Of the solution, which holds what is given."""
        return Priors(range_offset_m=self.config.range_offset_sd_m)


def _conclude(run: _Run, initial: _F64 | None) -> CameraLidarCalibration:
    solution = run.selection.solution
    splits = _splits(run, jackknife_covariance(solution))
    halves = splits[_FIRST_SECOND]
    drift = None if halves is None else halves.step
    covariance = full_covariance(solution, run.config.given(), drift)
    poses = np.array(solution.T_camera_plate)
    gauge = measure_gauge(run.selection.used, solution, run.priors, run.config.given())
    results = _pair_results(run)
    used = [r for r in results if r.used]
    sd = np.sqrt(np.diag(covariance))
    facts = Facts(
        pairs=len(run.pairs),
        sighted=len(run.sightings),
        used=len(used),
        rival=run.seed.rival,
        mistake=_mistake(run),
        sd_rotation_deg=np.degrees(sd[:3]),
        sd_translation_m=sd[3:6],
        splits=splits,
        spread=board_spread(poses),
        board_scale=gauge.board_scale,
        focal_scale=gauge.focal_scale,
        centre_off_deg=gauge.centre_off_deg,
        pattern_off_m=gauge.pattern_off_m,
        lens_fits_better=gauge.lens_fits_better,
        corner_rms_px=_rms([r.corner_rms_px for r in used]),
        point_rms_m=_rms([r.point_rms_m for r in used]),
        plate_found=_plate_found(run),
        moved_at=_moved_at(run),
        worse_than_initial=initial is not None
        and fits_better(run.selection, initial, [v.T_camera_plate for v in run.seed.views]),
    )
    verdict, why, advice = judge(facts)
    return CameraLidarCalibration(
        verdict=verdict,
        why=why,
        advice=advice,
        pairs=results,
        T_camera_lidar=solution.common.T_camera_lidar,
        covariance=covariance[:6, :6],
        reprojection_px=_rms([r.reprojection_px for r in used]),
        corner_rms_px=facts.corner_rms_px,
        point_rms_m=facts.point_rms_m,
        odd_even=splits[_ODD_EVEN],
        first_second=splits[_FIRST_SECOND],
        range_offset_m=Estimate(solution.common.range_offset_m, float(sd[OFFSET])),
        board_scale=facts.board_scale,
        focal_scale=facts.focal_scale,
        centre_off_deg=facts.centre_off_deg,
        pattern_off_m=facts.pattern_off_m,
        leave_one_out=leave_one_out(solution)[:, :6] if len(used) > 2 else None,
        spread=facts.spread,
    )


def _splits(run: _Run, covariance: _F64) -> dict[str, Split | None]:
    rows = np.arange(len(run.selection.rows))
    used, solution = run.selection.used, run.selection.solution
    return {
        _FIRST_SECOND: split_in_halves(used, solution, rows >= len(rows) / 2, covariance),
        _ODD_EVEN: split_in_halves(used, solution, rows % 2 == 1, covariance),
    }


def _mistake(run: _Run) -> tuple[str, str] | None:
    """Look for a usual mistake where too few pairs agree."""
    share = len(run.selection.rows) / len(run.sightings)
    if share >= CameraLidarLimits().share_good:
        return None
    return likely_mistake(run.sightings, run.seed, square_plate=run.square_plate)


def _moved_at(run: _Run) -> str | None:
    """Return the pair from which on, or up to which, all are left out, where these are several."""
    used = np.isin(np.arange(len(run.sightings)), run.selection.rows)
    first, last = np.flatnonzero(used)[[0, -1]]
    before, after = int(first), len(used) - 1 - int(last)
    if max(before, after) < 2:
        return None
    row = int(last) + 1 if after >= before else int(first)
    return run.sightings[row].pair.name


def _plate_found(run: _Run) -> tuple[Estimate, Estimate]:
    """Return the sides that the LiDAR sees over those given: median, and its error."""
    found = np.array([run.seed.clouds[k].board.size_found_m for k in run.selection.rows])
    ratio = found / np.array(run.plate_size_m)
    middle = np.median(ratio, axis=0)
    error = 1.4826 * np.median(np.abs(ratio - middle), axis=0) / np.sqrt(len(ratio))
    return (
        Estimate(float(middle[0]), float(error[0])),
        Estimate(float(middle[1]), float(error[1])),
    )


def _pair_results(run: _Run) -> tuple[PairResult, ...]:
    common = run.selection.solution.common
    joint = {
        row: _joint(run, row, T)
        for row, T in zip(run.selection.rows, run.selection.solution.T_camera_plate, strict=True)
    }
    of_sighting = {
        s.row: pair_result(
            s,
            run.seed.views[k],
            run.seed.clouds[k],
            run.camera,
            common,
            joint.get(k),
            None if k in joint else _reason(run, k),
        )
        for k, s in enumerate(run.sightings)
    }
    return tuple(
        of_sighting[row]
        if row in of_sighting
        else PairResult(
            name=pair.name,
            used=False,
            reason=run.reasons[row],
            board_points=0 if pair.board is None else len(pair.board.points),
        )
        for row, pair in enumerate(run.pairs)
    )


def _reason(run: _Run, row: int) -> str:
    reason = run.selection.reasons[row]
    partner = partner_of(
        row,
        run.sightings,
        run.selection.solution.common.T_camera_lidar,
        square_plate=run.square_plate,
    )
    if partner is None or len(run.selection.rows) < CameraLidarLimits().fewest_pairs_doubtful:
        return reason
    return f"{reason}; its image fits the cloud of '{partner}'"


def _joint(run: _Run, row: int, T_camera_plate: _F64) -> dict[str, float | _F64]:
    corners, points, _ = residuals_of(
        run.selection.data[row], run.selection.solution.common, T_camera_plate
    )
    return {
        "corner_rms_px": float(np.sqrt(2 * np.mean(corners**2))),
        "point_rms_m": float(np.sqrt(np.mean(points**2))),
        "T_camera_plate": T_camera_plate,
    }


def _rms(values: Sequence[float | None]) -> float:
    """Return the root mean square of numbers, infinite where one is missing."""
    known = np.array([np.inf if v is None else v for v in values])
    return float(np.sqrt(np.mean(known**2)))


def _nothing(pairs: Sequence[BoardPair], reasons: dict[int, str]) -> CameraLidarCalibration:
    return CameraLidarCalibration(
        verdict=Verdict.BAD,
        why=(f"in none of {len(pairs)} pairs both the camera and the LiDAR see the board",),
        advice=("Check the board's definition and its size against what the pairs say",),
        pairs=tuple(
            PairResult(name=p.name, used=False, reason=reasons[k]) for k, p in enumerate(pairs)
        ),
    )
