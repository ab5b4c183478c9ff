"""Lines of sight past boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from percept.core.sight_lines import is_hidden

_EYE = np.array([0.0, 0.0, 1.5])
_BOX = np.array([[10.0, 0.0, 0.75, 4.0, 2.0, 1.5, 0.0]])


@pytest.mark.parametrize(
    ("point", "hidden"),
    [
        ((20.0, 0.0, 0.0), True),  # behind it, on the ground
        ((7.9, 0.0, 0.0), False),  # before it
        ((20.0, 0.0, 2.0), False),  # over it
        ((20.0, 4.0, 0.0), False),  # beside it
        ((-20.0, 0.0, 0.0), False),  # behind the eye
        ((8.05, 0.0, 0.75), False),  # just on its near face: a box does not hide itself
        ((10.0, 0.0, 0.1), True),  # in it, well behind its face
    ],
)
def test_a_box_hides_what_is_behind_it(point: tuple[float, float, float], *, hidden: bool) -> None:
    assert is_hidden(_EYE, np.array([point]), _BOX).tolist() == [hidden]


def test_without_boxes_or_points_nothing_is_hidden() -> None:
    points = np.array([[1.0, 2.0, 3.0]])
    assert is_hidden(_EYE, points, np.zeros((0, 7))).tolist() == [False]
    assert is_hidden(_EYE, np.zeros((0, 3)), _BOX).shape == (0,)


def test_an_eye_inside_a_box_sees_nothing() -> None:
    around = np.array([[12.0, 0.0, 0.0], [-12.0, 3.0, 1.0]])
    assert is_hidden(np.array([10.0, 0.0, 0.75]), around, _BOX).all()


def test_a_line_along_an_axis_is_no_special_case() -> None:
    eye = np.array([0.0, 0.0, 0.5])
    points = np.array([[30.0, 0.0, 0.5], [30.0, 4.0, 0.5]])
    assert is_hidden(eye, points, _BOX).tolist() == [True, False]


@given(x=st.floats(3, 30), y=st.floats(-10, 10), yaw=st.floats(-3.2, 3.2), seed=st.integers(0, 999))
def test_turning_and_moving_all_changes_nothing(x: float, y: float, yaw: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.column_stack(
        [rng.uniform(-9, 9, (3, 2)), rng.uniform(0, 2, 3), rng.uniform(0.5, 4, (3, 3)), [0, 1, 2]]
    )
    points = rng.uniform([-15, -15, 0], [15, 15, 2], (40, 3))
    eye = np.array([-12.0, 0.3, 1.7])
    c, s = np.cos(yaw), np.sin(yaw)
    turn, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([x, y, 0.4])
    moved = boxes.copy()
    moved[:, :3] = boxes[:, :3] @ turn.T + shift
    moved[:, 6] += yaw
    before = is_hidden(eye, points, boxes)
    after = is_hidden(eye @ turn.T + shift, points @ turn.T + shift, moved)
    assert (before == after).mean() > 0.95  # what grazes an edge may fall on either side
