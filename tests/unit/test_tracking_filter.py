"""The Kalman update against the textbook, and boxes that do not know their front."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from percept.tracking.filter import (
    aligned_shapes,
    turn_to_course,
    update_positions,
    update_shapes,
    widened,
    wrap_angle,
)

_F64 = NDArray[np.float64]
_CAR = np.array([[4.0, 2.0, 1.5, 0.3]])


def _covariances(count: int, seed: int) -> _F64:
    roots = np.random.default_rng(seed).normal(size=(count, 6, 6))
    return roots @ roots.transpose(0, 2, 1)


def test_the_update_is_that_of_the_textbook() -> None:
    rng = np.random.default_rng(0)
    states, covariances = rng.normal(size=(4, 6)), _covariances(4, 1)
    measured, variances = rng.normal(size=(4, 3)), rng.uniform(0.1, 2, (4, 3))
    means, spreads = update_positions(states, covariances, measured, variances)
    H = np.eye(6)[:3]
    for k in range(4):
        S = H @ covariances[k] @ H.T + np.diag(variances[k])
        K = covariances[k] @ H.T @ np.linalg.inv(S)
        assert_allclose(means[k], states[k] + K @ (measured[k] - H @ states[k]), atol=1e-10)
        assert_allclose(spreads[k], (np.eye(6) - K @ H) @ covariances[k], atol=1e-10)


def test_covariances_stay_symmetric_and_positive() -> None:
    states, covariances = np.zeros((1, 6)), _covariances(1, 2) * 1e6
    for _ in range(200):
        states, covariances = update_positions(
            states, covariances, np.ones((1, 3)), np.full((1, 3), 1e-6)
        )
        assert np.array_equal(covariances, covariances.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(covariances).min() > -1e-9
    assert_allclose(states[0, :3], 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("measured", "named", "same_front"),
    [
        ([4.0, 2.0, 1.5, 0.4], [4.0, 2.0, 1.5, 0.4], True),
        ([4.0, 2.0, 1.5, 0.4 - np.pi], [4.0, 2.0, 1.5, 0.4], False),
        ([2.0, 4.0, 1.5, 0.4 + np.pi / 2], [4.0, 2.0, 1.5, 0.4], False),
        ([2.0, 4.0, 1.5, 0.4 - np.pi / 2], [4.0, 2.0, 1.5, 0.4], False),
        ([3.0, 2.9, 1.5, 0.3 + np.pi / 2], [2.9, 3.0, 1.5, 0.3], False),  # nearly square
    ],
)
def test_sides_are_named_as_the_track_does(
    measured: list[float],
    named: list[float],
    same_front: bool,  # noqa: FBT001
) -> None:
    aligned, agreed = aligned_shapes(_CAR, np.array([measured]))
    assert_allclose(aligned[0], named, atol=1e-12)
    assert agreed[0] == same_front


@given(st.floats(-7, 7), st.floats(-7, 7), st.floats(0.01, 1))
def test_the_yaw_takes_the_shorter_way(before: float, after: float, gain: float) -> None:
    shapes = np.array([[4.0, 2.0, 1.5, before]])
    measured = np.array([[4.0, 2.0, 1.5, after]])
    moved = update_shapes(shapes, measured, np.array([gain]))[0, 3]
    assert -np.pi < moved <= np.pi
    expected = gain * float(wrap_angle(np.array(after - before)))
    assert_allclose(np.cos(moved), np.cos(before + expected), atol=1e-9)
    assert_allclose(np.sin(moved), np.sin(before + expected), atol=1e-9)


def test_sizes_move_by_their_gain() -> None:
    moved = update_shapes(_CAR, np.array([[5.0, 1.0, 1.5, 0.3]]), np.array([0.25]))
    assert_allclose(moved[0], [4.25, 1.75, 1.5, 0.3])


def test_a_part_of_an_object_has_its_centre_elsewhere() -> None:
    variances = np.array([[0.04, 0.04, 0.01]])
    assert_allclose(widened(variances, _CAR, _CAR), variances)
    part = np.array([[2.4, 1.8, 1.0, 0.3]])  # 1.6 m short: its centre may be 0.8 m off
    assert_allclose(widened(variances, _CAR, part), [[0.68, 0.68, 0.01]])


def _turned(
    shape: list[float], velocity: tuple[float, float], *, facing: float = 1.0,
    agreed: bool = True, elongated: bool = True, speed_sd: float = 0.1,
) -> tuple[_F64, float]:  # fmt: skip
    states = np.array([[0.0, 0.0, 0.0, *velocity, 0.0]])
    covariances = np.eye(6)[None] * speed_sd**2
    shapes, votes = turn_to_course(
        np.array([shape]), np.array([facing]), states, covariances, np.array([agreed]),
        np.array([elongated]),
    )  # fmt: skip
    return shapes[0], float(votes[0])


def test_what_goes_backwards_turns_round() -> None:
    shape, _ = _turned([4.0, 2.0, 1.5, 0.1], (-10.0, 0.0))
    assert_allclose(shape, [4.0, 2.0, 1.5, 0.1 - np.pi])


def test_a_car_that_reverses_for_a_moment_keeps_its_front() -> None:
    shape, votes = _turned([4.0, 2.0, 1.5, 0.1], (-10.0, 0.0), facing=10.0)
    assert_allclose(shape[3], 0.1)
    assert votes == pytest.approx(8.0)


def test_a_slow_or_unsure_velocity_is_no_course() -> None:
    assert_allclose(_turned([4.0, 2.0, 1.5, 0.1], (-0.5, 0.0))[0][3], 0.1)
    assert_allclose(_turned([4.0, 2.0, 1.5, 0.1], (-5.0, 0.0), speed_sd=4.0)[0][3], 0.1)


def test_a_box_across_its_course_had_its_sides_confused() -> None:
    shape, _ = _turned([1.8, 0.6, 1.5, np.pi / 2], (10.0, 0.0))
    assert_allclose(shape, [0.6, 1.8, 1.5, 0.0], atol=1e-12)


def test_only_what_is_elongated_is_turned_by_a_quarter() -> None:
    shape, _ = _turned([1.8, 0.6, 1.5, np.pi / 2], (10.0, 0.0), elongated=False)
    assert_allclose(shape, [1.8, 0.6, 1.5, np.pi / 2])


def test_a_parked_car_that_became_wider_than_long_is_turned() -> None:
    shape, _ = _turned([1.8, 3.5, 1.5, 0.0], (0.0, 0.0))
    assert_allclose(shape, [3.5, 1.8, 1.5, np.pi / 2])


def test_detections_that_point_the_other_way_win_in_the_end() -> None:
    shape, facing = [4.0, 2.0, 1.5, 0.1], 2.0
    for expected in (0.1, 0.1, 0.1 - np.pi):
        turned, facing = _turned(shape, (0.0, 0.0), facing=facing, agreed=False)
        assert_allclose(turned[3], expected, atol=1e-12)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angles_are_the_same_angles(angle: float) -> None:
    wrapped = float(wrap_angle(np.array(angle)))
    assert -np.pi < wrapped <= np.pi
    assert_allclose([np.cos(wrapped), np.sin(wrapped)], [np.cos(angle), np.sin(angle)], atol=1e-9)
