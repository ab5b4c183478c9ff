"""What a calibration of several LiDARs says, with the means to distrust it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict
from percept.core.transform import quat_xyzw_from_matrix, rpy_from_rotation

__all__ = [
    "SEVERITY",
    "LidarCalibration",
    "LidarExtrinsic",
    "Pose",
    "RigLoop",
    "SceneClouds",
    "worst_verdict",
]

_F64 = NDArray[np.float64]

Pose = NDArray[np.float64]
"""(4, 4) rigid transform."""

SceneClouds = dict[str, NDArray[np.float32]]
"""Points (N, 3) of one scene by sensor name, metres, each in the sensor's own frame."""

SEVERITY = (Verdict.GOOD, Verdict.DOUBTFUL, Verdict.AMBIGUOUS, Verdict.BAD)


def worst_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the worst of some verdicts; good where there are none."""
    return max(verdicts, key=SEVERITY.index, default=Verdict.GOOD)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LidarExtrinsic:
    """Where one LiDAR sits, seen from the reference LiDAR.

    Attributes:
        sensor: Its name.
        T_reference_sensor: (4, 4) float64, maps points of the sensor into the reference; None
            where no place was found.
        sd_translation_m: (3,) standard deviations of the sensor's origin along x, y, z of the
            reference, metres.
        sd_rotation_deg: (3,) standard deviations of a small rotation about x, y, z of the
            reference, degrees.
        leave_one_out_translation_m: Largest move of the origin when one scene is left out; None
            with one scene.
        leave_one_out_rotation_deg: Largest turn when one scene is left out; None with one scene.
        rms_m: Of the distances between points and the surfaces that they were matched with.
        overlap: Share of the sensor's points, 0 to 1, that meet what the neighbour on the path saw.
        scenes_agreeing: Scenes whose own answer is this one, of all that were used, as "5/6".
        weak_directions: Directions that the scenes hold loosely, in words.
        verdict: How far this one can be trusted.
        why: The reason, as a sentence without a full stop.
        advice: What to do about it.
        path: Names from the reference to the sensor along the registrations that place it.
        T_reference_start: (4, 4) the place that was given, or None.
        rivals: Other places (4, 4) that the scenes allow too.
    """

    sensor: str
    T_reference_sensor: _F64 | None
    sd_translation_m: _F64
    sd_rotation_deg: _F64
    leave_one_out_translation_m: float | None
    leave_one_out_rotation_deg: float | None
    rms_m: float
    overlap: float
    scenes_agreeing: str
    weak_directions: tuple[str, ...]
    verdict: Verdict
    why: str
    advice: tuple[str, ...] = ()
    path: tuple[str, ...] = ()
    T_reference_start: _F64 | None = None
    rivals: tuple[_F64, ...] = ()

    def rpy_deg(self) -> _F64:
        """Return fixed-axis roll, pitch and yaw (3,) in degrees; NaN without a place."""
        if self.T_reference_sensor is None:
            return np.full(3, np.nan)
        return np.degrees(rpy_from_rotation(self.T_reference_sensor[:3, :3]))

    def as_json(self) -> dict[str, Any]:
        """Return the entry of the document; what is not known is null."""
        placed = self.T_reference_sensor
        return {
            "sensor": self.sensor,
            "T_reference_sensor": None if placed is None else placed.tolist(),
            "translation_m": None if placed is None else placed[:3, 3].tolist(),
            "quat_xyzw": None if placed is None else quat_xyzw_from_matrix(placed[:3, :3]).tolist(),
            "sd_translation_m": _finite(self.sd_translation_m),
            "sd_rotation_deg": _finite(self.sd_rotation_deg),
            "leave_one_out_max": {
                "translation_m": self.leave_one_out_translation_m,
                "rotation_deg": self.leave_one_out_rotation_deg,
            },
            "rms_m": _finite_number(self.rms_m),
            "overlap": _finite_number(self.overlap),
            "scenes_agreeing": self.scenes_agreeing,
            "weak_directions": list(self.weak_directions),
            "verdict": str(self.verdict),
            "why": self.why,
            "advice": list(self.advice),
            "path": list(self.path),
            "rivals": [rival.tolist() for rival in self.rivals],
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class RigLoop:
    """How far a round trip through registrations misses its start.

    Attributes:
        path: Names of the sensors, the first one again at the end.
        translation_m: Length of what is left of the translation.
        rotation_deg: Angle of what is left of the rotation.
        sd_translation_m: What the spreads of the registrations let expect of it.
        sd_rotation_deg: The same of the rotation.
        surprise: Length of the error in standard deviations of its own, all six numbers
            together: 1 is what is expected.
        agrees: Whether the error is within the limits.
    """

    path: tuple[str, ...]
    translation_m: float
    rotation_deg: float
    sd_translation_m: float
    sd_rotation_deg: float
    surprise: float
    agrees: bool

    def as_json(self) -> dict[str, Any]:
        """Return the entry of the document."""
        return {
            "path": list(self.path),
            "translation_m": self.translation_m,
            "rotation_deg": self.rotation_deg,
            "sd_translation_m": self.sd_translation_m,
            "sd_rotation_deg": self.sd_rotation_deg,
            "surprise": self.surprise,
            "agrees": self.agrees,
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LidarCalibration:
    """The LiDARs of a rig, placed in the frame of one of them.

    Attributes:
        reference: Name of the LiDAR whose frame everything is given in.
        extrinsics: The other LiDARs.
        loops: Closure errors of the round trips that the registrations allow.
        verdict: The worst of the sensors'.
        why: The reasons, the weightiest first.
        advice: What to do, the most useful first.
        scenes: Scenes that were used, each of another place.
        pairs: What each registration of two sensors found, as plain values for `as_json`.
        dropped: What was left out, by reason.
    """

    reference: str
    extrinsics: tuple[LidarExtrinsic, ...]
    loops: tuple[RigLoop, ...]
    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    scenes: int
    pairs: tuple[dict[str, Any], ...] = ()
    dropped: dict[str, int] = field(default_factory=dict)

    def transforms(self) -> dict[str, _F64]:
        """Return `T_reference_sensor` (4, 4) of every sensor with a place, and the reference's."""
        placed = {
            e.sensor: e.T_reference_sensor
            for e in self.extrinsics
            if e.T_reference_sensor is not None
        }
        return {self.reference: np.eye(4), **placed}

    def as_json(self) -> dict[str, Any]:
        """Return the document of `percept calib lidar --json`, without NaN."""
        return {
            "reference": self.reference,
            "verdict": str(self.verdict),
            "extrinsics": [extrinsic.as_json() for extrinsic in self.extrinsics],
            "loops": [loop.as_json() for loop in self.loops],
            "why": list(self.why),
            "advice": list(self.advice),
            "scenes": self.scenes,
            "pairs": list(self.pairs),
            "dropped": dict(self.dropped),
        }


def _finite_number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _finite(values: _F64) -> list[float | None]:
    return [_finite_number(value) for value in values]
