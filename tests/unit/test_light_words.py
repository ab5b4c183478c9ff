"""Class names of light detectors."""

from __future__ import annotations

import pytest

from percept.lights import Reading, light_label


@pytest.mark.parametrize(
    ("label", "reading"),
    [
        ("light_red", Reading.RED),
        ("light_yellow", Reading.YELLOW),
        ("light_green", Reading.GREEN),
        ("light_off", Reading.DARK),
        ("red", Reading.RED),
        ("off", Reading.DARK),
        ("Red", Reading.RED),
        ("RedStraightLeft", Reading.RED),
        ("GreenStraight", Reading.GREEN),
        ("traffic_light-yellow", Reading.YELLOW),
        ("Traffic Light Green Arrow", Reading.GREEN),
        ("traffic light", Reading.UNREADABLE),
        ("traffic_light", Reading.UNREADABLE),
    ],
)
def test_words_of_lights(label: str, reading: Reading) -> None:
    assert light_label(label) is reading


@pytest.mark.parametrize(
    "label", ["car", "red car", "street light", "light", "redraw", "red_green", "", "stop sign",
              "pedestrian_light_red", "left"],
)  # fmt: skip
def test_other_things_are_no_lights(label: str) -> None:
    assert light_label(label) is None
