"""The rules of a check: axes, controls, who moved, the verdict. Measurements are made up."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.check.axes import (
    base_motion,
    base_sd,
    check_pair,
    plant_controls,
    reversed_measurement,
    tolerances,
)
from percept.calib.check.check import check_calibration
from percept.calib.check.movers import find_movers
from percept.calib.check.result import AXES, CalibrationCheck, Control, Measurement, PairCheck
from percept.calib.check.verdict import conclude
from percept.calib.lidars.registration import apply_step
from percept.calib.limits import CheckLimits
from percept.core.errors import InsufficientDataError, UsageError
from percept.core.results import Verdict
from percept.core.transform import rotation_from_rpy

Matrix = NDArray[np.float64]

_LIMITS = CheckLimits()
_COVARIANCE = np.diag([1e-4] * 3 + [0.002] * 3) ** 2


def _pose(x: float, y: float, z: float, roll: float, yaw: float) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(roll, 0.1, yaw)
    T[:3, 3] = x, y, z
    return T


_RIG = {
    "top": _pose(1, 0, 2, 0, 0.3),
    "left": _pose(1, 0.7, 1.7, 0.2, 1.4),
    "right": _pose(1, -0.7, 1.7, -0.2, -1.4),
    "front": _pose(3.5, 0, 0.6, 0, 0),
}


def _moved(shift: Mapping[str, float]) -> Matrix:
    """Return a step (6,) of rotation (rad) and shift (m) from metres and degrees by axis."""
    step = np.zeros(6)
    for axis, amount in shift.items():
        index = AXES.index(axis)
        step[(index + 3) % 6] = amount if index < 3 else np.radians(amount)
    return step


def _controls(undetected: str = "") -> dict[str, Control]:
    missed = undetected.split()
    return {
        name: Control(
            planted=0.05 if k < 3 else 1.0,
            found=0.0 if name in missed else 1.0,
            held_out=True,
            detected=name not in missed,
        )
        for k, name in enumerate(AXES)
    }


def _measured(
    against: str,
    sensor: str,
    moves: Mapping[str, Mapping[str, float]] | None = None,
    **changed: Any,
) -> Measurement:
    """Return what a pair measures when sensors are off the rig."""
    now = {n: apply_step(T, _moved((moves or {}).get(n, {}))) for n, T in _RIG.items()}
    values: dict[str, Any] = {
        "T_against_sensor": np.linalg.inv(now[against]) @ now[sensor],
        "covariance": _COVARIANCE,
        "controls": _controls(),
        "kind": "lidar",
        "scenes": 3,
        "confirmed": True,
        "verdict": Verdict.GOOD,
        "why": ("Because.",),
        **changed,
    }
    return Measurement(against=against, sensor=sensor, **values)


def _check(*measured: Measurement) -> list[PairCheck]:
    return [check_pair(one, _RIG, _LIMITS) for one in measured]


def _verdict(*measured: Measurement) -> CalibrationCheck:
    pairs = tuple(_check(*measured))
    return conclude(CalibrationCheck(verdict=Verdict.GOOD, why=(), advice=(), pairs=pairs), ())


@pytest.mark.parametrize("axis", AXES)
def test_a_move_shows_on_its_own_axis_of_the_base(axis: str) -> None:
    amount = 0.05 if axis in AXES[:3] else 1.0
    (pair,) = _check(_measured("top", "left", {"left": {axis: amount}}))
    assert pair.axes[axis].delta == pytest.approx(amount, abs=1e-9)
    assert {n for n, a in pair.axes.items() if a.verdict == "moved"} == {axis}
    assert len(pair.judged) == 6
    assert pair.verdict is Verdict.BAD


@pytest.mark.parametrize(
    ("shift_m", "confirmed", "verdict"),
    [
        (0.015, True, "holds"),
        (0.025, True, "not judged"),
        (0.04, True, "moved"),
        (0.04, False, "not judged"),
        (0.06, False, "moved"),
    ],
)
def test_between_holding_and_moved_nothing_is_claimed(
    shift_m: float, *, confirmed: bool, verdict: str
) -> None:
    (pair,) = _check(_measured("top", "left", {"left": {"y": shift_m}}, confirmed=confirmed))
    assert pair.axes["y"].verdict == verdict
    assert (pair.axes["y"].reason is None) == (verdict == "holds")


def test_a_wide_spread_widens_the_tolerance_to_3_sd_of_a_difference() -> None:
    sd = np.array([0.02] * 3 + [0.5] * 3)
    assert tolerances("lidar", sd, _LIMITS) == pytest.approx(3 * np.sqrt(2) * sd)
    assert tolerances("camera", 0 * sd, _LIMITS).tolist() == [0.01] * 3 + [0.1] * 3


def test_an_axis_without_a_control_is_not_judged_however_far_it_is_off() -> None:
    move = {"left": {"x": 0.5}}
    (pair,) = _check(_measured("top", "left", move, controls=_controls("x")))
    assert pair.axes["x"].verdict == "not judged"
    assert "went unnoticed" in str(pair.axes["x"].reason)
    assert "not judged: x" in pair.why
    assert pair.verdict is Verdict.DOUBTFUL


def test_a_control_is_found_when_the_solver_returns_and_not_when_it_stays() -> None:
    sd = np.full(6, 1e-3)
    T = _RIG["left"]
    for solve, detected in ((lambda _: T, True), (lambda start: start, False)):
        controls = plant_controls("lidar", _RIG["top"], sd, [(T, solve)], _LIMITS, held_out=True)
        assert {control.detected for control in controls.values()} == {detected}
    wide = plant_controls(
        "lidar", _RIG["top"], 100 * sd, [(T, lambda _: T)], _LIMITS, held_out=True
    )
    assert not wide["x"].detected


def test_scenes_that_contradict_each_other_say_that_it_moved_in_the_log() -> None:
    (pair,) = _check(_measured("top", "left", contradictions={"z": 0.12}))
    assert pair.axes["z"].verdict == "moved"
    assert "while the log was made" in str(pair.axes["z"].reason)


def test_a_measurement_seen_from_the_other_sensor_says_the_same_backwards() -> None:
    measured = _measured("top", "left", {"left": {"z": 0.05}})
    back = reversed_measurement(measured)
    assert (back.against, back.sensor) == ("left", "top")
    assert check_pair(back, _RIG, _LIMITS).deltas()[2] == pytest.approx(-0.05)
    again = reversed_measurement(back)
    assert again.covariance == pytest.approx(measured.covariance, abs=1e-12)


def test_motions_and_spreads_are_along_the_axes_of_the_base() -> None:
    T_base = _pose(0, 0, 0, 0, np.pi / 2)
    T_base[:3, :3] = rotation_from_rpy(0, 0, np.pi / 2)
    before, after = np.eye(4), np.eye(4)
    after[0, 3] = 0.1
    assert base_motion(T_base, before, after) == pytest.approx([0, 0.1, 0, 0, 0, 0])
    covariance = np.diag([0, 0, 0, 0.03, 0.01, 0.02]) ** 2
    assert base_sd(T_base, covariance)[:3] == pytest.approx([0.01, 0.03, 0.02])


_Names = tuple[str, str]
_PAIRS: tuple[_Names, ...] = (("top", "left"), ("top", "right"), ("left", "right"))


@pytest.mark.parametrize("mover", ["top", "left", "right"])
@pytest.mark.parametrize("pairs", [_PAIRS, _PAIRS[:2]], ids=["all pairs", "star"])
def test_the_one_whose_pairs_all_disagree_moved(mover: str, pairs: tuple[_Names, ...]) -> None:
    moves = {mover: {"y": 0.06, "yaw": 1.0}}
    found = find_movers(_check(*(_measured(a, b, moves) for a, b in pairs)), _RIG, _LIMITS)
    assert found == ((mover,),)


def test_two_sensors_cannot_tell_which_of_them_moved() -> None:
    found = find_movers(_check(_measured("top", "left", {"left": {"x": 0.1}})), _RIG, _LIMITS)
    assert found == (("left",), ("top",))


def test_pairs_that_see_different_moves_do_not_blame_the_sensor_between_them() -> None:
    moves = {"left": {"y": 0.1}, "right": {"y": 0.2}}
    measured = [_measured(a, b, moves) for a, b in _PAIRS[:2]]
    found = find_movers(_check(*measured), _RIG, _LIMITS)
    assert ("top",) not in found
    assert ("left", "right") in found


def test_nobody_moved_where_all_pairs_hold() -> None:
    assert find_movers(_check(*(_measured(*pair) for pair in _PAIRS)), _RIG, _LIMITS) == ()


def test_all_axes_of_all_sensors_make_a_rig_good() -> None:
    result = _verdict(*(_measured(*pair) for pair in _PAIRS))
    assert result.verdict is Verdict.GOOD
    assert "left" in result.why[0]


def test_two_sensors_that_share_no_view_are_tied_by_a_third() -> None:
    blind = _measured(
        "left", "right", T_against_sensor=None, controls={}, verdict=Verdict.BAD, confirmed=False
    )
    tied = _verdict(_measured("top", "left"), _measured("top", "right"), blind)
    assert tied.verdict is Verdict.GOOD
    alone = _verdict(_measured("top", "left"), blind)
    assert alone.verdict is Verdict.DOUBTFUL


@pytest.mark.parametrize(
    ("changed", "verdict"),
    [
        ({"confirmed": False}, Verdict.DOUBTFUL),
        ({"verdict": Verdict.DOUBTFUL}, Verdict.DOUBTFUL),
        ({"controls": _controls("yaw")}, Verdict.DOUBTFUL),
        ({"controls": _controls(" ".join(AXES))}, Verdict.BAD),
        ({"T_against_sensor": None, "verdict": Verdict.BAD}, Verdict.BAD),
        ({"T_against_sensor": None, "verdict": Verdict.AMBIGUOUS}, Verdict.AMBIGUOUS),
    ],
)
def test_what_is_not_judged_or_confirmed_is_never_good(changed: Any, verdict: Verdict) -> None:
    result = _verdict(_measured("top", "left", **changed))
    assert result.verdict is verdict
    assert result.why
    assert result.advice


def test_the_document_has_no_nan_and_names_every_axis() -> None:
    document = _verdict(
        _measured("top", "left", T_against_sensor=None, controls={}, verdict=Verdict.BAD)
    ).as_json()
    (entry,) = document["sensors"]
    assert entry["delta_translation_m"] == [None] * 3
    assert entry["sd_rotation_deg"] == [None] * 3
    assert entry["axes"] == dict.fromkeys(AXES, "not judged")
    assert document["moved"] == []


def test_a_sensor_without_a_place_or_without_a_partner_is_refused() -> None:
    cloud = np.ones((10, 3))
    with pytest.raises(UsageError, match="does not say where 'roof' sits"):
        check_calibration(_RIG, scenes=[{"top": cloud, "roof": cloud}])
    with pytest.raises(InsufficientDataError, match="no two sensors"):
        check_calibration(_RIG, scenes=[{"top": cloud}])
    with pytest.raises(UsageError, match="none of the LiDARs"):
        check_calibration(_RIG, scenes=[{"top": cloud, "left": cloud}], reference="front")
