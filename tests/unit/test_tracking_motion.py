"""Motion models: against worked numbers, a matrix exponential, and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.linalg import expm

from percept.tracking.config import ClassSettings
from percept.tracking.motion import MotionModel, motion_model, predict_turns

_F64 = NDArray[np.float64]
_SETTINGS = ClassSettings(velocity_walk_mps=2.0, height_walk_m=0.5, turn_walk_radps=0.4)
_NO_NOISE = np.zeros((1, 3))


def _some_covariance(size: int, seed: int = 0) -> _F64:
    root = np.random.default_rng(seed).normal(size=(size, size))
    return (root @ root.T)[None]


def _predict(model: MotionModel, state: _F64, dt_s: float, covariance: _F64) -> tuple[_F64, _F64]:
    states, covariances, _ = model.predict(state[None], covariance, np.array([dt_s]))
    return states[0], covariances[0]


def test_constant_velocity_goes_straight() -> None:
    model = motion_model("velocity", _SETTINGS)
    state, _ = _predict(model, np.array([1.0, 2.0, 3.0, 4.0, -2.0]), 0.5, np.zeros((1, 5, 5)))
    assert_allclose(state, [3.0, 1.0, 3.0, 4.0, -2.0], atol=1e-12)


def test_a_quarter_of_a_circle() -> None:
    # 10 m/s with a quarter turn per second: radius 20/pi, from (0, 0) heading east to north.
    model = motion_model("turn", _SETTINGS)
    start = np.array([0.0, 0.0, 1.0, 10.0, 0.0, np.pi / 2])
    state, _ = _predict(model, start, 1.0, np.zeros((1, 6, 6)))
    radius = 20 / np.pi
    assert_allclose(state, [radius, radius, 1.0, 0.0, 10.0, np.pi / 2], atol=1e-12)


@given(
    vx=st.floats(-30, 30), vy=st.floats(-30, 30),
    turn=st.one_of(st.floats(-2, 2), st.floats(-1e-3, 1e-3), st.just(0.0)), dt=st.floats(0, 3),
)  # fmt: skip
def test_the_jacobian_is_the_derivative(vx: float, vy: float, turn: float, dt: float) -> None:
    start = np.array([5.0, -3.0, 1.0, vx, vy, turn])
    step = 1e-5
    shifts = np.vstack([np.eye(6), -np.eye(6)]) * step
    spread = np.zeros((12, 6, 6))
    moved, _, _ = predict_turns(start + shifts, spread, np.full(12, dt), np.zeros((12, 3)))
    numeric = ((moved[:6] - moved[6:]) / (2 * step)).T
    _, _, jacobians = predict_turns(start[None], spread[:1], np.array([dt]), _NO_NOISE)
    assert_allclose(jacobians[0], numeric, atol=1e-5)


def test_noise_is_that_of_white_acceleration() -> None:
    # Van Loan (1978): the noise of continuous time from one matrix exponential.
    dt, rate = 0.7, np.zeros((5, 5))
    rate[0, 3] = rate[1, 4] = 1.0
    density = np.diag([0.0, 0.0, 0.5**2, 2.0**2, 2.0**2])
    block = expm(np.block([[-rate, density], [np.zeros((5, 5)), rate.T]]) * dt)
    transition = block[5:, 5:].T
    before = _some_covariance(5)
    model = motion_model("velocity", _SETTINGS)
    _, after = _predict(model, np.arange(5.0), dt, before)
    expected = transition @ before[0] @ transition.T + transition @ block[:5, 5:]
    assert_allclose(after, expected, atol=1e-12)


@given(st.floats(0.01, 2), st.floats(0.01, 2))
def test_two_short_predictions_are_one_long_one(first: float, second: float) -> None:
    model = motion_model("velocity", _SETTINGS)
    state, before = np.array([1.0, 2.0, 3.0, -4.0, 5.0]), _some_covariance(5)
    middle, spread = _predict(model, state, first, before)
    two = _predict(model, middle, second, spread[None])
    one = _predict(model, state, first + second, before)
    assert_allclose(two[0], one[0], rtol=1e-9, atol=1e-12)
    assert_allclose(two[1], one[1], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", ["velocity", "turn"])
def test_no_time_changes_nothing(name: str) -> None:
    model = motion_model(name, _SETTINGS)
    state = np.array([1.0, 2.0, 3.0, -4.0, 5.0, 0.3])[: model.size]
    before = _some_covariance(model.size)
    states, covariances, jacobians = model.predict(state[None], before, np.zeros(1))
    assert_allclose(states[0], state)
    assert_allclose(covariances, before)
    assert_allclose(jacobians[0], np.eye(model.size))


def test_an_object_that_does_not_turn_is_one_of_constant_velocity() -> None:
    straight, turning = motion_model("velocity", _SETTINGS), motion_model("turn", _SETTINGS)
    state, before = np.array([1.0, 2.0, 3.0, -4.0, 5.0]), _some_covariance(5)
    whole = np.zeros((1, 6, 6))
    whole[:, :5, :5] = before
    mean, spread = _predict(straight, state, 0.3, before)
    whole_mean, whole_spread = _predict(turning, np.append(state, 0.0), 0.3, whole)
    assert_allclose(whole_mean[:5], mean)
    assert_allclose(whole_spread[:5, :5], spread)


def test_what_others_read_off_a_state() -> None:
    model = motion_model("turn", _SETTINGS)
    states = np.arange(12.0).reshape(2, 6)
    covariances = np.arange(72.0).reshape(2, 6, 6)
    assert (model.name, model.size) == ("turn", 6)
    assert_allclose(model.velocity(states), [[3, 4], [9, 10]])
    assert_allclose(model.velocity_covariance(states, covariances)[0], [[21, 22], [27, 28]])
    assert_allclose(model.difference(states[:1], states[1:]), [[-6.0] * 6])
