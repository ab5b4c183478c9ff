"""Which answer is given of probabilities."""

from __future__ import annotations

import numpy as np
import pytest

from percept.lights.config import DecisionConfig
from percept.lights.decision import decide

# red, yellow, green, dark, flashing red, flashing yellow
_CASES = [
    ((0.90, 0.05, 0.05, 0.00, 0.00, 0.00), "red", False),
    ((0.50, 0.05, 0.05, 0.00, 0.40, 0.00), "red", False),  # open whether it flashes, red it is
    ((0.00, 0.05, 0.95, 0.00, 0.00, 0.00), "green", False),
    ((0.01, 0.00, 0.99, 0.00, 0.00, 0.00), "unknown", False),  # red is not excluded
    ((0.00, 0.00, 0.99, 0.00, 0.01, 0.00), "unknown", False),  # nor is flashing red
    ((0.06, 0.06, 0.00, 0.88, 0.00, 0.00), "unknown", False),
    ((0.01, 0.00, 0.00, 0.99, 0.00, 0.00), "dark", False),
    ((0.01, 0.00, 0.00, 0.00, 0.98, 0.01), "red", True),
    ((0.01, 0.00, 0.00, 0.01, 0.49, 0.49), "unknown", True),  # no lit lamp was seen
]


@pytest.mark.parametrize(("classes", "state", "flashing"), _CASES)
def test_answers(classes: tuple[float, ...], state: str, *, flashing: bool) -> None:
    may = np.array([True])
    answers = decide(np.array([classes]), DecisionConfig(), may_flash=may, flashed=~may)
    assert answers.states == (state,)
    assert answers.flashing.tolist() == [flashing]


def test_probability_is_that_of_the_answer() -> None:
    classes = np.array([case[0] for case in _CASES])
    may = np.ones(len(classes), bool)
    answers = decide(classes, DecisionConfig(), may_flash=may, flashed=~may)
    np.testing.assert_allclose(
        answers.probabilities, [0.90, 0.50, 0.95, 0.99, 0.99, 0.88, 0.99, 0.98, 0.98]
    )


def test_flashing_is_not_said_before_its_time_and_lasts() -> None:
    likely, fading = np.array([[0.0, 0, 0, 0, 1.0, 0]]), np.array([[0.4, 0, 0, 0, 0.6, 0]])
    no, yes = np.array([False]), np.array([True])
    config = DecisionConfig()
    assert not decide(likely, config, may_flash=no, flashed=no).flashing[0]
    assert decide(fading, config, may_flash=yes, flashed=yes).flashing[0]
    assert not decide(fading, config, may_flash=yes, flashed=no).flashing[0]
