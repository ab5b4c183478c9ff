"""What classes of networks are called in a data set."""

from __future__ import annotations

import pytest

from percept.datasets.labelling.prelabels.categories import CategoryConfig, category_of, kind_of


@pytest.mark.parametrize(
    ("word", "category"),
    [
        ("person", "pedestrian"),
        ("Pedestrian", "pedestrian"),
        ("traffic cone", "cone"),
        ("fire hydrant", "fire_hydrant"),
        ("bus", "bus"),  # of the kind of trucks, but another thing
        ("bicycle", "bicycle"),
        ("light_red", "traffic_light_red"),
        ("traffic light red", "traffic_light_red"),
        ("RedStraightLeft", "traffic_light_red"),
        ("traffic light", "traffic_light"),
        ("light_off", "traffic_light_off"),
        ("traffic light yellow", "traffic_light_yellow"),
        ("Straßenschild", "straßenschild"),
        ("unknown", "unknown"),
    ],
)
def test_one_word_for_one_thing(word: str, category: str) -> None:
    assert category_of(word, CategoryConfig()) == category


def test_state_of_a_light_can_be_cut() -> None:
    config = CategoryConfig(light_states="cut")
    for word in ("light_red", "traffic light green", "traffic light", "light_off"):
        assert category_of(word, config) == "traffic_light"
    assert category_of("red car", config) == "red_car"


def test_names_of_the_user_win() -> None:
    config = CategoryConfig(names={"Light Red": "ampel", "person": "Fußgänger", "deer": ""})
    assert category_of("light_red", config) == "ampel"
    assert category_of("person", config) == "Fußgänger"
    assert category_of("pedestrian", config) == "pedestrian"
    assert category_of("deer", config) == ""


def test_kinds_are_coarser_than_categories() -> None:
    assert kind_of("bus") == kind_of("truck") != kind_of("car")
    assert kind_of("traffic_light_red") == kind_of("traffic_light") == "traffic_light"
    assert kind_of("fire_hydrant") == "fire_hydrant"
