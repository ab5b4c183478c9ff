"""The check of a rig in worlds with known truth: false alarms, moves, axes not judged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.calib.check.check import check_calibration
from percept.calib.check.result import AXES, CalibrationCheck
from percept.calib.lidars.registration import apply_step
from percept.core.results import Verdict
from percept.core.transform import rotation_from_rpy

Matrix = NDArray[np.float64]

_RANGE_SD_M = 0.01
_FARTHEST_M = 45.0
_YARD = ((4, 2.5, 1.0, 1.5), (7, -3, 1.5, 2), (-5, -2, 1.2, 1.4), (-3, 3.5, 0.8, 2.5), (9, 2, 1, 3))
"""Boxes of the yard: x, y, half the side, height."""


def _pose(x: float, y: float, z: float, roll: float, yaw: float) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(roll, 0.0, yaw)
    T[:3, 3] = x, y, z
    return T


_RIG = {
    "top": _pose(1.0, 0.0, 1.9, 0.0, 0.0),
    "left": _pose(0.9, 0.7, 1.7, 0.2, 0.5),
    "right": _pose(0.9, -0.7, 1.7, -0.2, -0.5),
}


class _Rays:
    """Rays from one sensor into a world of planes along the axes."""

    def __init__(self, T_base_sensor: Matrix, count: int, rng: np.random.Generator) -> None:
        directions = rng.normal(size=(4 * count, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        self.own = directions[np.abs(directions[:, 2]) < 0.5][:count]
        self.directions = self.own @ T_base_sensor[:3, :3].T
        self.origin = T_base_sensor[:3, 3]
        self.ranges = np.full(len(self.own), np.inf)

    def meet(self, axis: int, at_m: float, within: Matrix | None = None) -> None:
        """Meet a plane across an axis, or the part of it within bounds (3, 2)."""
        with np.errstate(divide="ignore"):
            ranges = (at_m - self.origin[axis]) / self.directions[:, axis]
        ranges[~(ranges > 0.1)] = np.inf
        if within is not None:
            known = np.where(np.isfinite(ranges), ranges, 0)
            points = self.origin + known[:, None] * self.directions
            inside = ((points >= within[:, 0]) & (points <= within[:, 1])).all(axis=1)
            ranges[~inside] = np.inf
        self.ranges = np.minimum(self.ranges, ranges)

    def points(self, rng: np.random.Generator) -> Matrix:
        """Return what comes back, in the sensor's frame."""
        back = self.ranges < _FARTHEST_M
        noisy = self.ranges[back] + rng.normal(scale=_RANGE_SD_M, size=int(back.sum()))
        return self.own[back] * noisy[:, None]


def _cloud(T: Matrix, at_x_m: float, rng: np.random.Generator, *, street: bool) -> Matrix:
    """Return the cloud of a sensor in a yard, or beside one endless wall."""
    rays = _Rays(T, 4000, rng)
    rays.meet(2, 0.0)
    rays.meet(1, 6.0)
    if not street:
        rays.meet(1, -5.0)
        rays.meet(0, 14.0 - at_x_m)
        rays.meet(0, -9.0 - at_x_m)
        for x, y, half, height in _YARD:
            sides = np.array([[x - at_x_m - half, x - at_x_m + half], [y - half, y + half]])
            bounds = np.vstack([sides, [0, height]])
            for axis in (0, 1):
                free = bounds.copy()
                free[axis] = -np.inf, np.inf
                rays.meet(axis, float(bounds[axis, 0]), free)
                rays.meet(axis, float(bounds[axis, 1]), free)
    return rays.points(rng)


def _scenes(
    seed: int,
    names: Sequence[str] = ("top", "left"),
    places_m: Sequence[float] = (0.0, 3.0),
    *,
    street: bool = False,
) -> list[dict[str, Matrix]]:
    rng = np.random.default_rng(seed)
    return [{n: _cloud(_RIG[n], x, rng, street=street) for n in names} for x in places_m]


def _shifted(sensor: str, axis: str, amount: float) -> dict[str, Matrix]:
    """Return the rig with one place changed by metres or degrees in the base's axes."""
    step = np.zeros(6)
    index = AXES.index(axis)
    step[(index + 3) % 6] = amount if index < 3 else np.radians(amount)
    return {**_RIG, sensor: apply_step(_RIG[sensor], step)}


def _false_alarms(result: CalibrationCheck) -> list[str]:
    return [name for pair in result.pairs for name in AXES if pair.axes[name].verdict == "moved"]


def test_a_rig_that_holds_is_good_and_every_control_was_found_in_other_scenes() -> None:
    names = ("top", "left", "right")
    result = check_calibration(_RIG, scenes=_scenes(0, names), focal_px=1000)
    assert result.verdict is Verdict.GOOD
    assert (result.moved, result.suspects) == ((), ())
    for pair in result.pairs:
        assert set(pair.judged) == set(AXES)
        assert np.abs(pair.deltas()[:3]).max() < 0.002
        assert np.abs(pair.deltas()[3:]).max() < 0.02
        for control in pair.measured.controls.values():
            assert control.held_out
            assert control.found == pytest.approx(control.planted, rel=0.1)


@pytest.mark.parametrize("axis", ["x", pytest.param("yaw", marks=pytest.mark.slow)])
def test_the_sensor_that_moved_is_named_with_its_move(axis: str) -> None:
    amount = 0.05 if axis in AXES[:3] else 1.0
    rig = _shifted("left", axis, amount)
    result = check_calibration(rig, scenes=_scenes(1, ("top", "left", "right")), focal_px=1000)
    assert result.verdict is Verdict.BAD
    (moved,) = result.moved
    assert moved.sensor == "left"
    expected = np.zeros(6)
    expected[AXES.index(axis)] = -amount
    found = np.concatenate([moved.delta_translation_m, moved.delta_rotation_deg])
    assert np.abs(found - expected)[:3].max() < 0.003
    assert np.abs(found - expected)[3:].max() < 0.03
    assert np.allclose(moved.T_base_sensor, _RIG["left"], atol=3e-3)
    assert moved.px_at_20_m == pytest.approx(1000 * moved.off_at_20_m / 20)
    assert "'left' moved" in result.why[0]
    assert "percept calib lidar" in result.advice[0]


def test_of_two_sensors_it_is_not_said_which_one_moved() -> None:
    result = check_calibration(_shifted("left", "y", -0.05), scenes=_scenes(2))
    assert result.verdict is Verdict.BAD
    assert result.moved == ()
    assert sorted(result.suspects) == [("left",), ("top",)]
    assert "cannot say which" in result.why[0]


@pytest.mark.slow
def test_a_sensor_that_was_turned_around_is_found_without_a_guess() -> None:
    rig = _shifted("left", "yaw", 150.0)
    result = check_calibration(rig, scenes=_scenes(3, ("top", "left", "right")))
    assert [moved.sensor for moved in result.moved] == ["left"]
    assert abs(abs(result.moved[0].delta_rotation_deg[2]) - 150.0) < 0.1


def test_along_an_endless_wall_forward_is_not_judged_and_the_rest_is() -> None:
    for places_m, rig in (((0.0, 3.0), _RIG), ((0.0,), _shifted("left", "x", 0.05))):
        result = check_calibration(rig, scenes=_scenes(4, places_m=places_m, street=True))
        (pair,) = result.pairs
        assert result.verdict is Verdict.DOUBTFUL
        assert pair.axes["x"].verdict == "not judged"
        assert pair.axes["x"].reason
        assert not _false_alarms(result)
        assert {"y", "z", "roll"} <= set(pair.judged)
        assert "not judged: x" in result.why[0]


def test_one_scene_is_doubtful_and_shows_gross_moves_only() -> None:
    scenes = _scenes(5, places_m=(0.0,))
    assert check_calibration(_RIG, scenes=scenes).verdict is Verdict.DOUBTFUL
    small = check_calibration(_shifted("left", "z", 0.04), scenes=scenes)
    assert small.verdict is Verdict.DOUBTFUL
    assert small.pairs[0].axes["z"].verdict == "not judged"
    large = check_calibration(_shifted("left", "z", 0.08), scenes=scenes)
    assert large.verdict is Verdict.BAD


def test_clouds_that_do_not_overlap_are_not_judged() -> None:
    here, there = _scenes(6, street=True), _scenes(7)
    scenes = [{"top": a["top"], "left": b["left"]} for a, b in zip(here, there, strict=True)]
    result = check_calibration(_RIG, scenes=scenes)
    assert result.verdict in (Verdict.BAD, Verdict.AMBIGUOUS)
    assert not _false_alarms(result)
    assert result.pairs[0].judged == ()


@pytest.mark.slow
def test_false_alarms_and_misses_over_twenty_streets() -> None:
    rng = np.random.default_rng(0)
    wrong = missed = 0
    for seed in range(20):
        scenes = _scenes(100 + seed)
        result = check_calibration(_RIG, scenes=scenes)
        wrong += bool(_false_alarms(result)) or result.verdict is not Verdict.GOOD
        axis = AXES[int(rng.integers(6))]
        amount = 0.05 if axis in AXES[:3] else 1.0
        moved = check_calibration(_shifted("left", axis, amount), scenes=scenes)
        missed += moved.pairs[0].axes[axis].verdict != "moved"
    assert (wrong, missed) == (0, 0)
