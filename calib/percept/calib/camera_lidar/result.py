"""What a camera-LiDAR calibration says, and how it reads as JSON."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.calib.camera_lidar.degeneracy import BoardSpread
from percept.calib.camera_lidar.spread import Split
from percept.core.results import Verdict

__all__ = ["CameraLidarCalibration", "Estimate", "PairResult"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its standard deviation."""

    value: float
    sd: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairResult:
    """What became of one pair.

    Attributes:
        name: Its name.
        used: Whether the result rests on it.
        reason: Why not, or None.
        board_points: Points on the board in the cloud; 0 where none was found.
        reprojection_px: How far the corners of the board as the LiDAR alone sees it fall from
            those in the image, root mean square; None where either has no board or no
            transform was found.
        corner_rms_px: Of the corners about the joint solution; None where not used.
        point_rms_m: Of the points about the board's plane; None where not used.
        shift_m: (3,) board of the LiDAR less that of the camera, along the board's width, height
            and normal.
        tilt_deg: Angle between the two normals.
        T_camera_plate: (4, 4) where the plate is, by the joint solution or the image alone.
        T_lidar_plate: (4, 4) where it is by the LiDAR alone.
    """

    name: str
    used: bool
    reason: str | None
    board_points: int = 0
    reprojection_px: float | None = None
    corner_rms_px: float | None = None
    point_rms_m: float | None = None
    shift_m: _F64 | None = None
    tilt_deg: float | None = None
    T_camera_plate: _F64 | None = None
    T_lidar_plate: _F64 | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the entry of `pairs`."""
        return {
            "name": self.name,
            "used": self.used,
            "reason": self.reason,
            "board_points": self.board_points,
            "reprojection_px": self.reprojection_px,
            "corner_rms_px": self.corner_rms_px,
            "point_rms_mm": None if self.point_rms_m is None else 1000 * self.point_rms_m,
            "shift_mm": None if self.shift_m is None else (1000 * self.shift_m).tolist(),
            "tilt_deg": self.tilt_deg,
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraLidarCalibration:
    """A transform from a LiDAR to a camera, and how far it can be trusted.

    Attributes:
        verdict: How far.
        why: Reasons, the weightiest first.
        advice: What to do, the most useful first.
        T_camera_lidar: (4, 4) maps points of the LiDAR's frame into the camera's optical frame;
            None where no pair could be used.
        covariance: (6, 6) of a small rotation vector (rad) and a shift (m), both in the camera's
            axes, the LiDAR's origin staying in place under the rotation.
        reprojection_px: Root mean square over pairs of how far the board as the LiDAR alone sees
            it falls from the one in the image.
        corner_rms_px: Of the corners about the joint solution.
        point_rms_m: Of the points about the boards' planes.
        odd_even: Every second pair against the rest; None with fewer than three in a half.
        first_second: The first half of the pairs against the second.
        range_offset_m: What is added to a measured range to correct it.
        board_scale: Size of the printed pattern over the given one, as the LiDAR says.
        focal_scale: Focal length over the given one, as the LiDAR says.
        centre_off_deg: How far the principal point lies from the given one, as the LiDAR says,
            as an angle: right and down.
        pattern_off_m: How far the pattern lies off the plate's middle, along columns and rows.
        leave_one_out: (P, 6) how the transform moves without each used pair.
        spread: Where the boards stood.
        pairs: All pairs, in the order given.
    """

    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    pairs: tuple[PairResult, ...]
    T_camera_lidar: _F64 | None = None
    covariance: _F64 | None = None
    reprojection_px: float | None = None
    corner_rms_px: float | None = None
    point_rms_m: float | None = None
    odd_even: Split | None = None
    first_second: Split | None = None
    range_offset_m: Estimate | None = None
    board_scale: Estimate | None = None
    focal_scale: Estimate | None = None
    centre_off_deg: tuple[Estimate, Estimate] | None = None
    pattern_off_m: tuple[Estimate, Estimate] | None = None
    leave_one_out: _F64 | None = None
    spread: BoardSpread | None = None

    @property
    def sd_rotation_deg(self) -> _F64 | None:
        """(3,) standard deviations about the camera's x, y and z."""
        return (
            None if self.covariance is None else np.degrees(np.sqrt(np.diag(self.covariance)[:3]))
        )

    @property
    def sd_translation_m(self) -> _F64 | None:
        """(3,) standard deviations along the camera's x, y and z."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance)[3:])

    def spread_at(self, distance_m: float) -> float:
        """Return the standard deviation in metres across the line of sight, straight ahead.

        Args:
            distance_m: Distance of the point from the camera, along its axis.

        Raises:
            ValueError: If no transform was found.
        """
        if self.covariance is None:
            raise ValueError("no transform was found")
        turn = np.array([[0, distance_m, 0], [-distance_m, 0, 0]], dtype=np.float64)
        J = np.column_stack([turn, np.eye(3)[:2]])
        return float(np.sqrt(np.trace(J @ self.covariance @ J.T)))

    def as_json(self) -> dict[str, Any]:
        """Return the document of `--json` and `calibration.json`."""
        T, offset = self.T_camera_lidar, self.range_offset_m
        inverse = None if T is None else np.linalg.inv(T)
        return {
            "T_camera_lidar": None if T is None else T.tolist(),
            "T_lidar_camera": None if inverse is None else inverse.tolist(),
            "reprojection_px": self.reprojection_px,
            "point_to_board_mm": _times(self.point_rms_m, 1000),
            "corner_rms_px": self.corner_rms_px,
            "sd_translation_m": _listed(self.sd_translation_m),
            "sd_rotation_deg": _listed(self.sd_rotation_deg),
            "odd_even": _split(self.odd_even),
            "first_second": _split(self.first_second),
            "leave_one_out_max": self._leave_one_out_max(),
            "range_offset_mm": None if offset is None else 1000 * offset.value,
            "range_offset_sd_mm": None if offset is None else 1000 * offset.sd,
            "board_scale": _estimate(self.board_scale),
            "focal_scale": _estimate(self.focal_scale),
            "centre_off_deg": None
            if self.centre_off_deg is None
            else [_estimate(e) for e in self.centre_off_deg],
            "pattern_off_m": None
            if self.pattern_off_m is None
            else [_estimate(e) for e in self.pattern_off_m],
            "verdict": str(self.verdict),
            "why": "; ".join(self.why),
            "advice": list(self.advice),
            "pairs": [pair.as_json() for pair in self.pairs],
        }

    def _leave_one_out_max(self) -> dict[str, float] | None:
        moves = self.leave_one_out
        if moves is None or len(moves) < 2:
            return None
        return {
            "translation_m": float(np.linalg.norm(moves[:, 3:], axis=1).max()),
            "rotation_deg": float(np.degrees(np.linalg.norm(moves[:, :3], axis=1).max())),
        }


def _listed(values: _F64 | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _split(split: Split | None) -> dict[str, float] | None:
    if split is None:
        return None
    return {"translation_m": split.translation_m, "rotation_deg": split.rotation_deg}


def _estimate(estimate: Estimate | None) -> dict[str, float] | None:
    return None if estimate is None else {"value": estimate.value, "sd": estimate.sd}
