"""What a check of a rig says: what holds, what moved, and what could not be judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict

__all__ = [
    "AXES",
    "AxisCheck",
    "AxisVerdict",
    "CalibrationCheck",
    "Control",
    "IntrinsicsCheck",
    "Measurement",
    "MovedSensor",
    "PairCheck",
]

_F64 = NDArray[np.float64]

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
"""Along, then about, the axes of the rig's base frame: forward, left and up."""


class AxisVerdict(StrEnum):
    """What is said about one axis of one pair of sensors."""

    HOLDS = "holds"
    MOVED = "moved"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True, slots=True)
class Control:
    """A shift along or about one axis that was planted, and what the same test made of it.

    Attributes:
        planted: Size of the shift, metres or degrees.
        found: The smallest that was found of it, in the direction that was planted.
        held_out: Whether it was looked for in data that the planted place was not made from.
        detected: Whether the test did not let it pass as holding.
        determined: Whether the shapes of what both see fix the axis at all; in a corridor an
            estimate can lock onto noise, and come back to where it was.
    """

    planted: float
    found: float
    held_out: bool
    detected: bool
    determined: bool = True


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measurement:
    """Where one sensor sits as seen from another, by the new data alone.

    Attributes:
        against: The sensor that is taken to be in its place.
        sensor: The other one.
        T_against_sensor: (4, 4), or None where nothing can be said.
        covariance: (6, 6) rotation (rad), then translation (m), along the axes of `against`:
            ``R <- exp(w) R``, ``t <- t + s``.
        controls: Outcome for each of `AXES`; empty without a transform.
        contradictions: Largest difference between scenes beyond its spread, by axis.
        kind: "lidar" or "camera": which limits apply.
        scenes: Scenes, or poses of the board, that it rests on.
        confirmed: Whether more than one scene says so.
        verdict: Of the solver.
        why: Of the solver.
    """

    against: str
    sensor: str
    T_against_sensor: _F64 | None
    covariance: _F64
    controls: Mapping[str, Control]
    contradictions: Mapping[str, float] = field(default_factory=dict)
    kind: str
    scenes: int
    confirmed: bool
    verdict: Verdict
    why: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AxisCheck:
    """One axis: the verdict, how far it is off, its spread, and why nothing else is said.

    Attributes:
        verdict: Holds, moved or not judged.
        delta: The measured place less that of the rig, metres or degrees.
        sd: Standard deviation of the measured place, metres or degrees.
        tolerance: What still counts as holding, metres or degrees.
        reason: Why it is not judged, or what moved; None where it holds.
    """

    verdict: AxisVerdict
    delta: float
    sd: float
    tolerance: float
    reason: str | None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PairCheck:
    """One sensor against another one that is taken to be where the rig says.

    Attributes:
        measured: What it rests on.
        T_against_sensor: (4, 4) by the rig.
        axes: For each of `AXES`.
        verdict: Of this pair alone.
        why: In a sentence.
    """

    measured: Measurement
    T_against_sensor: _F64
    axes: Mapping[str, AxisCheck]
    verdict: Verdict
    why: str

    @property
    def sensor(self) -> str:
        """The sensor whose place is looked at."""
        return self.measured.sensor

    @property
    def against(self) -> str:
        """The sensor that it is compared with."""
        return self.measured.against

    @property
    def moved(self) -> bool:
        """Whether one of the two moved."""
        return any(axis.verdict is AxisVerdict.MOVED for axis in self.axes.values())

    @property
    def judged(self) -> tuple[str, ...]:
        """The axes that are judged."""
        return tuple(n for n, a in self.axes.items() if a.verdict is not AxisVerdict.NOT_JUDGED)

    def deltas(self) -> _F64:
        """Return (6,) metres and degrees, as `AXES`."""
        return np.array([self.axes[name].delta for name in AXES])

    def as_json(self) -> dict[str, Any]:
        """Return the entry of `sensors`; what is not known is null."""
        delta = [_number(self.axes[name].delta) for name in AXES]
        sd = [_number(self.axes[name].sd) for name in AXES]
        found = self.measured.T_against_sensor
        return {
            "sensor": self.sensor,
            "against": self.against,
            "delta_translation_m": delta[:3],
            "delta_rotation_deg": delta[3:],
            "sd_translation_m": sd[:3],
            "sd_rotation_deg": sd[3:],
            "tolerance": {name: _number(axis.tolerance) for name, axis in self.axes.items()},
            "axes": {name: str(axis.verdict) for name, axis in self.axes.items()},
            "reasons": {name: axis.reason for name, axis in self.axes.items() if axis.reason},
            "control": {
                name: {
                    "planted": control.planted,
                    "found": _number(control.found),
                    "held_out": control.held_out,
                    "detected": control.detected,
                    "determined": control.determined,
                }
                for name, control in self.measured.controls.items()
            },
            "scenes": self.measured.scenes,
            "T_against_sensor_rig": self.T_against_sensor.tolist(),
            "T_against_sensor_found": None if found is None else found.tolist(),
            "verdict": str(self.verdict),
            "why": self.why,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class IntrinsicsCheck:
    """A camera's intrinsics, as the boards in its images see them.

    Attributes:
        camera: Its name.
        reprojection_px: Root mean square of corners about their own board.
        focal_scale: Focal length over the given one as the LiDAR says, and its spread; NaN where
            nothing is known.
        focal_scale_sd: See `focal_scale`.
        verdict: Good where they hold, bad where they are not this camera's.
        why: In a sentence.
    """

    camera: str
    reprojection_px: float
    focal_scale: float
    focal_scale_sd: float
    verdict: Verdict
    why: str

    def as_json(self) -> dict[str, Any]:
        """Return the entry of `intrinsics`."""
        return {
            "camera": self.camera,
            "reprojection_px": _number(self.reprojection_px),
            "focal_scale": _number(self.focal_scale),
            "focal_scale_sd": _number(self.focal_scale_sd),
            "verdict": str(self.verdict),
            "why": self.why,
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MovedSensor:
    """A sensor that moved.

    Attributes:
        sensor: Its name.
        delta_translation_m: (3,) shift of its origin along the base frame's axes.
        delta_rotation_deg: (3,) turn about them.
        off_at_20_m: By how much a point 20 m away comes out wrong, metres.
        px_at_20_m: The same in pixels of the rig's camera, or None without one.
        T_base_sensor: (4, 4) where it is now, by the best of the measurements.
    """

    sensor: str
    delta_translation_m: _F64
    delta_rotation_deg: _F64
    off_at_20_m: float
    px_at_20_m: float | None
    T_base_sensor: _F64

    def as_json(self) -> dict[str, Any]:
        """Return the entry of `corrections`."""
        return {
            "sensor": self.sensor,
            "delta_translation_m": self.delta_translation_m.tolist(),
            "delta_rotation_deg": self.delta_rotation_deg.tolist(),
            "off_at_20_m_m": self.off_at_20_m,
            "off_at_20_m_px": self.px_at_20_m,
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CalibrationCheck:
    """Whether a rig holds.

    Attributes:
        verdict: Good where all holds, bad where a sensor moved.
        why: Reasons, the weightiest first.
        advice: What to do.
        pairs: The pairs of sensors that were compared.
        moved: The sensors that moved, where it can be said which.
        suspects: Groups of sensors, one of which moved, where it cannot.
        if_moved: What each suspect did, if it was that one.
        intrinsics: The cameras' intrinsics.
        not_checked: Sensors that nothing was said about, and why.
        dropped: What was left out, by reason.
    """

    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    pairs: tuple[PairCheck, ...]
    moved: tuple[MovedSensor, ...] = ()
    suspects: tuple[tuple[str, ...], ...] = ()
    if_moved: tuple[MovedSensor, ...] = ()
    intrinsics: tuple[IntrinsicsCheck, ...] = ()
    not_checked: Mapping[str, str] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the document of `--json` and `calibration.json`, without NaN."""
        return {
            "verdict": str(self.verdict),
            "why": list(self.why),
            "advice": list(self.advice),
            "sensors": [pair.as_json() for pair in self.pairs],
            "moved": [moved.sensor for moved in self.moved],
            "one_of_these_moved": [list(group) for group in self.suspects],
            "corrections": [moved.as_json() for moved in (*self.moved, *self.if_moved)],
            "intrinsics": [entry.as_json() for entry in self.intrinsics],
            "not_checked": dict(self.not_checked),
            "dropped": dict(self.dropped),
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
