"""What a class of a network is called in a data set: one word for one thing, by name alone."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from percept.core.class_words import common_word, kind_of_word, plain_word
from percept.core.light_words import Reading, light_label
from percept.core.settings import Settings

__all__ = ["UNKNOWN", "CategoryConfig", "category_of", "kind_of"]

UNKNOWN = "unknown"
"""What a 3D box is called of which nothing but its shape is known."""

_LIGHT = "traffic_light"
_STATES = {Reading.DARK: "off", Reading.UNREADABLE: ""}


class CategoryConfig(Settings):
    """What classes are called.

    Attributes:
        names: Names to use in place of what a network says, by its word; an empty name leaves
            the class out. Case, blanks and hyphens of the word do not matter.
        light_states: Whether what a traffic light shows is a part of its class, such as
            `traffic_light_red`, or left out. Most formats know nothing of a box but its class, so
            the state would be lost, and a class can be cut later but not be found again.
    """

    names: dict[str, str] = Field(default_factory=dict)
    light_states: Literal["keep", "cut"] = "keep"


def category_of(word: str, config: CategoryConfig) -> str:
    """Return what a class is called in the data set; empty for one that is left out.

    Args:
        word: What a network, or a track, says; that of a light with its state, if it is known.
        config: Settings.
    """
    given = {plain_word(key): name for key, name in config.names.items()}
    if plain_word(word) in given:
        return given[plain_word(word)]
    light = light_label(word)
    if light is None:
        return common_word(word)
    state = _STATES.get(light, light.name.lower()) if config.light_states == "keep" else ""
    return f"{_LIGHT}_{state}" if state else _LIGHT


def kind_of(category: str) -> str:
    """Return the kind of object that a category is of: `truck` for `bus`, one for all lights."""
    return kind_of_word(category) if light_label(category) is None else _LIGHT
