"""The hidden Markov model of the classes, by hand, and the words of detectors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from percept.tracking.class_model import ClassModel, class_of_word
from percept.tracking.config import ClassSettings, TrackerConfig

_INDEX = {"car": 0, "truck": 1, "cyclist": 2, "pedestrian": 3, "unknown": 4}
_TWO = TrackerConfig(
    classes={"car": ClassSettings(), "truck": ClassSettings()},
    confusions={"car": {"truck": 0.1}, "truck": {"car": 0.3}},
    class_change_per_s=0.5,
)


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("car", "car"), ("Car", "car"), ("person", "pedestrian"), ("bicycle", "cyclist"),
        ("motorcycle", "cyclist"), ("bus", "truck"), ("BOX_TRUCK", "truck"), ("Van", "car"),
        ("REGULAR_VEHICLE", "car"), ("Person sitting", "pedestrian"), ("box-truck", "truck"),
    ],
)  # fmt: skip
def test_words_of_networks_stand_for_classes(word: str, name: str) -> None:
    assert class_of_word(word, _INDEX) == _INDEX[name]


@pytest.mark.parametrize("word", ["traffic light", "dining table", "", "cone"])
def test_other_words_stand_for_none(word: str) -> None:
    assert class_of_word(word, _INDEX) == -1


def test_a_class_of_the_settings_wins_over_an_alias() -> None:
    assert class_of_word("bus", {**_INDEX, "bus": 5}) == 5


def test_columns_of_the_confusion_are_distributions() -> None:
    model = ClassModel(TrackerConfig())
    assert_allclose(model.confusion.sum(axis=0), 1.0)
    assert (np.diag(model.confusion) > 0.5).all()
    said_unknown = model.confusion[model.names.index("unknown")]
    assert_allclose(said_unknown[: model.names.index("unknown")], 0.2)


def test_one_update_by_hand() -> None:
    # P(car|car) .9, P(truck|car) .1, P(car|truck) .3, P(truck|truck) .7; "car" with 0.8:
    # likelihood of car .8*.9 + .2*.1 = .74, of truck .8*.3 + .2*.7 = .38.
    model = ClassModel(_TWO)
    evidence = model.evidence(np.array([0]), np.array([0.8]))
    assert_allclose(evidence, [[0.74, 0.38]])
    belief = model.updated(np.array([[0.4, 0.6]]), evidence)
    car, truck = 0.4 * 0.74, 0.6 * 0.38
    assert_allclose(belief, [[car / (car + truck), truck / (car + truck)]])


def test_a_belief_fades_to_equal_shares() -> None:
    model = ClassModel(_TWO)
    stay = np.exp(-0.5 * 2.0)
    assert_allclose(model.faded(np.array([[1.0, 0.0]]), 2.0), [[0.5 + stay / 2, 0.5 - stay / 2]])
    two_steps = model.faded(model.faded(np.array([[0.9, 0.1]]), 0.7), 1.3)
    assert_allclose(two_steps, model.faded(np.array([[0.9, 0.1]]), 2.0))
    assert_allclose(model.faded(np.array([[0.9, 0.1]]), 1e6), [[0.5, 0.5]])


def test_confidences_outside_0_to_1_are_clipped() -> None:
    model = ClassModel(_TWO)
    logits = model.evidence(np.array([0, 0]), np.array([7.5, -3.0]))
    assert_allclose(logits, model.evidence(np.array([0, 0]), np.array([1.0, 0.0])))
    assert (logits > 0).all()


def test_flicker_does_not_change_a_stable_class() -> None:
    model = ClassModel(TrackerConfig())
    car, truck = model.words(("car", "truck"))
    belief = model.prior()[None]
    said = [car] * 6 + [truck] + [car] * 3
    for word in said:
        evidence = model.evidence(np.array([word]), np.array([0.8]))
        belief = model.updated(model.faded(belief, 0.1), evidence)
        assert model.names[belief.argmax()] == "car"
    for _ in range(12):
        evidence = model.evidence(np.array([truck]), np.array([0.8]))
        belief = model.updated(model.faded(belief, 0.1), evidence)
    assert model.names[belief.argmax()] == "truck"


def test_the_cost_of_a_class_is_the_focal_loss() -> None:
    model = ClassModel(_TWO)
    certain_car = np.array([[1.0, 0.0]])
    costs = model.focal_cost(certain_car, np.array([0, 1]), np.array([1.0, 1.0]))
    fit = 0.1 / 0.7  # "truck" is said of a car with .1, of a truck with .7
    assert_allclose(costs, [[0.0, -((1 - fit) ** 2) * np.log(fit)]])


def test_an_unsure_word_costs_less() -> None:
    model = ClassModel(_TWO)
    costs = model.focal_cost(np.array([[1.0, 0.0]]), np.array([1, 1]), np.array([0.9, 0.3]))[0]
    assert 0 < costs[1] < 0.2 * costs[0]


def test_unknown_fits_to_everything_more_than_another_class_does() -> None:
    model = ClassModel(TrackerConfig())
    words = model.words(("unknown", "pedestrian"))
    car = np.eye(len(model.names))[[model.names.index("car")]]
    unknown, pedestrian = model.focal_cost(car, words, np.array([0.9, 0.9]))[0]
    assert unknown < 0.5 * pedestrian
