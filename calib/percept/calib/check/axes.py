"""The test that every axis of every pair of sensors has to pass, and its known-bad control.

The new data give a place of the sensor by themselves. It is compared with the rig's along and
about the axes of the base frame. Whether the comparison could have failed is tried by planting a
shift of known size: a place that is known to be wrong must not pass (after Calibrex's rule that a
shift of 1 deg or 5 cm has to raise held-out chi-square by 9, which is 3 standard deviations).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.calib.check.result import (
    AXES,
    AxisCheck,
    AxisVerdict,
    Control,
    Measurement,
    PairCheck,
)
from percept.calib.lidars.registration import apply_step
from percept.calib.lidars.rig_graph import PairEdge, relative_motion
from percept.calib.limits import CheckLimits
from percept.core.results import Verdict

__all__ = [
    "base_motion",
    "base_sd",
    "check_pair",
    "floors",
    "plant_controls",
    "reversed_measurement",
    "size",
    "tolerances",
]

_F64 = NDArray[np.float64]
_UNKNOWN = np.full(6, np.nan)


def base_motion(T_base_against: _F64, T_before: _F64, T_after: _F64) -> _F64:
    """Return (6,) the shift (m), then turn (deg) of a sensor along and about the base's axes.

    Args:
        T_base_against: (4, 4) of the sensor that it is seen from.
        T_before: (4, 4) `T_against_sensor`.
        T_after: (4, 4) likewise.
    """
    motion = relative_motion(T_base_against @ T_before, T_base_against @ T_after)
    return np.concatenate([motion[3:], np.degrees(motion[:3])])


def base_sd(T_base_against: _F64, covariance: _F64) -> _F64:
    """Return (6,) standard deviations in metres and degrees along the base's axes.

    Args:
        T_base_against: (4, 4) of the sensor that the covariance is seen from.
        covariance: (6, 6) rotation, then translation, in that sensor's axes.
    """
    if not np.isfinite(covariance).all():
        return np.full(6, np.inf)
    turned = np.kron(np.eye(2), T_base_against[:3, :3])
    sd = np.sqrt(np.diag(turned @ covariance @ turned.T))
    return np.concatenate([sd[3:], np.degrees(sd[:3])])


def floors(kind: str, limits: CheckLimits) -> _F64:
    """Return (6,) what always counts as holding, metres and degrees."""
    if kind == "camera":
        return np.repeat([limits.camera_floor_m, limits.camera_floor_deg], 3)
    return np.repeat([limits.lidar_floor_m, limits.lidar_floor_deg], 3)


def tolerances(kind: str, sd: _F64, limits: CheckLimits) -> _F64:
    """Return (6,) what still counts as holding: sd of a difference, or the floor.

    Args:
        kind: "lidar" or "camera".
        sd: (6,) of the new measurement, metres and degrees.
        limits: The limits.
    """
    least = floors(kind, limits)
    return np.asarray(np.maximum(limits.tolerance_sd * np.sqrt(2) * sd, least), dtype=np.float64)


def plant_controls(
    kind: str,
    T_base_against: _F64,
    sd: _F64,
    folds: Sequence[tuple[_F64, Callable[[_F64], _F64]]],
    limits: CheckLimits,
    *,
    held_out: bool,
) -> dict[str, Control]:
    """Plant a shift along and about each axis, and see whether the test finds it.

    What halves differ by has opposite signs in the two of them, and is in `sd` already: the mean
    over the parts says whether the data lead back from a wrong place at all.

    Args:
        kind: "lidar" or "camera".
        T_base_against: (4, 4).
        sd: (6,) of the measurement, metres and degrees.
        folds: For each part of the data: `T_against_sensor` by the other data, and the solver of
            the part, from a start (4, 4) to its end.
        limits: The limits.
        held_out: Whether the parts and the other data share nothing.
    """
    controls = {}
    tolerance = tolerances(kind, sd, limits)
    for index, name in enumerate(AXES):
        planted = limits.control_m if index < 3 else limits.control_deg
        seen = []
        for T_other, solve in folds:
            T_wrong = _planted(T_base_against, T_other, index, planted)
            seen.append(-base_motion(T_base_against, T_wrong, solve(T_wrong))[index])
        found = float(np.mean(seen))
        controls[name] = Control(planted, found, held_out, bool(found > tolerance[index]))
    return controls


def _planted(T_base_against: _F64, T: _F64, index: int, amount: float) -> _F64:
    step = np.zeros(6)
    step[(index + 3) % 6] = amount if index < 3 else np.radians(amount)
    moved = apply_step(T_base_against @ T, step)
    return np.asarray(np.linalg.inv(T_base_against) @ moved, dtype=np.float64)


def reversed_measurement(measured: Measurement) -> Measurement:
    """Return the same measurement with the sensors exchanged; controls and axes stay."""
    T = measured.T_against_sensor
    turned = replace(measured, against=measured.sensor, sensor=measured.against)
    if T is None:
        return turned
    edge = PairEdge(measured.against, measured.sensor, T, measured.covariance, 1.0).reversed()
    return replace(turned, T_against_sensor=edge.T_target_source, covariance=edge.covariance)


def check_pair(
    measured: Measurement, T_base_sensor: Mapping[str, _F64], limits: CheckLimits
) -> PairCheck:
    """Judge every axis of a pair of sensors.

    Args:
        measured: What the new data say.
        T_base_sensor: (4, 4) by the rig, of both sensors.
        limits: The limits.
    """
    T_base_against = T_base_sensor[measured.against]
    T_rig = np.asarray(np.linalg.inv(T_base_against) @ T_base_sensor[measured.sensor])
    delta, sd = _UNKNOWN, _UNKNOWN
    if measured.T_against_sensor is not None:
        delta = base_motion(T_base_against, T_rig, measured.T_against_sensor)
        sd = base_sd(T_base_against, measured.covariance)
    tolerance = tolerances(measured.kind, sd, limits)
    axes = {
        name: _check_axis(measured, k, float(delta[k]), float(sd[k]), float(tolerance[k]), limits)
        for k, name in enumerate(AXES)
    }
    verdict, why = _pair_verdict(measured, axes)
    return PairCheck(measured=measured, T_against_sensor=T_rig, axes=axes, verdict=verdict, why=why)


def _check_axis(
    measured: Measurement,
    index: int,
    delta: float,
    sd: float,
    tolerance: float,
    limits: CheckLimits,
) -> AxisCheck:
    name = AXES[index]
    control = measured.controls.get(name)
    if measured.T_against_sensor is None or control is None:
        nothing = "nothing can be said about this pair"
        return AxisCheck(AxisVerdict.NOT_JUDGED, delta, sd, tolerance, nothing)
    if not control.detected:
        reason = _undetected(name, control, sd)
        return AxisCheck(AxisVerdict.NOT_JUDGED, delta, sd, tolerance, reason)
    if name in measured.contradictions:
        between = size(name, measured.contradictions[name])
        reason = f"scenes of this log differ by {between}: it moved while the log was made"
        return AxisCheck(AxisVerdict.MOVED, delta, sd, tolerance, reason)
    if abs(delta) <= tolerance:
        return AxisCheck(AxisVerdict.HOLDS, delta, sd, tolerance, None)
    if abs(delta) > _move_from(index, sd, limits, confirmed=measured.confirmed):
        return AxisCheck(AxisVerdict.MOVED, delta, sd, tolerance, f"off by {size(name, delta)}")
    where = "" if measured.confirmed else " by one scene only"
    reason = (
        f"off by {size(name, delta)}{where}: more than the tolerance of {size(name, tolerance)}, "
        "less than what tells a move from the sensors' own errors"
    )
    return AxisCheck(AxisVerdict.NOT_JUDGED, delta, sd, tolerance, reason)


def _move_from(index: int, sd: float, limits: CheckLimits, *, confirmed: bool) -> float:
    """Return how far an axis must be off at least before a sensor is said to have moved."""
    least = (limits.moved_m, limits.moved_deg)[index // 3]
    if not confirmed:
        least = (limits.one_scene_m, limits.one_scene_deg)[index // 3]
    return max(limits.moved_sd * float(np.sqrt(2)) * sd, least)


def _undetected(name: str, control: Control, sd: float) -> str:
    planted = size(name, control.planted)
    if not control.determined:
        return "the shapes of what both see do not determine it"
    if control.found < control.planted / 2:
        return (
            f"a planted shift of {planted} went unnoticed (found {size(name, control.found)}): "
            "what both see says nothing about it"
        )
    return f"a planted shift of {planted} does not stand out of the spread ({size(name, sd)})"


def size(name: str, value: float) -> str:
    """Return a length or an angle along an axis, in words."""
    return f"{100 * value:.1f} cm" if name in AXES[:3] else f"{value:.2f} deg"


def _pair_verdict(measured: Measurement, axes: Mapping[str, AxisCheck]) -> tuple[Verdict, str]:
    if measured.T_against_sensor is None:
        kept = measured.verdict is Verdict.AMBIGUOUS
        return (Verdict.AMBIGUOUS if kept else Verdict.BAD), " ".join(measured.why)
    moved = [name for name, axis in axes.items() if axis.verdict is AxisVerdict.MOVED]
    if moved:
        listed = ", ".join(f"{name}: {axes[name].reason}" for name in moved)
        return Verdict.BAD, f"one of the two moved ({listed})"
    unknown = [name for name, axis in axes.items() if axis.verdict is AxisVerdict.NOT_JUDGED]
    if len(unknown) == len(AXES):
        return Verdict.BAD, f"no axis could be judged: {_reasons(unknown, axes)}"
    if unknown:
        held = ", ".join(name for name in AXES if name not in unknown)
        return Verdict.DOUBTFUL, f"{held} hold; not judged: {_reasons(unknown, axes)}"
    if not measured.confirmed:
        return Verdict.DOUBTFUL, "all axes hold, by one scene only, which nothing confirms"
    if measured.verdict is not Verdict.GOOD:
        return Verdict.DOUBTFUL, f"all axes hold, but: {' '.join(measured.why)}"
    return Verdict.GOOD, "all axes hold"


def _reasons(names: Sequence[str], axes: Mapping[str, AxisCheck]) -> str:
    return "; ".join(f"{name}: {axes[name].reason}" for name in names)
