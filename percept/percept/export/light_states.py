"""What a traffic light is said to show, in one word and one colour, the same everywhere."""

from __future__ import annotations

from percept.core.results import LightStates
from percept.export.canvas import Rgb

__all__ = ["LIGHT_COLOURS", "NOT_SEEN", "shown_state"]

NOT_SEEN = "not seen"

LIGHT_COLOURS: dict[str, Rgb] = {
    "red": (222, 56, 49),
    "yellow": (245, 196, 36),
    "green": (32, 168, 104),
    "dark": (48, 53, 58),
    "unknown": (160, 171, 182),
    NOT_SEEN: (98, 106, 114),
    "red flashing": (240, 140, 130),
    "yellow flashing": (250, 226, 146),
    "green flashing": (136, 214, 176),
    "dark flashing": (98, 106, 114),
    "unknown flashing": (205, 212, 219),
}
"""Colours by what `shown_state` says."""


def shown_state(lights: LightStates, row: int) -> str:
    """Return what a light shows: `red`, `red flashing`, `dark`, `unknown` or `not seen`.

    A light that no camera saw, and of which the state is not known either, is not seen.

    Args:
        lights: The lights of a moment.
        row: Which of them.
    """
    state = lights.states[row] if lights.states[row] in LIGHT_COLOURS else "unknown"
    if lights.flashing[row]:
        return f"{state} flashing"
    return NOT_SEEN if state == "unknown" and not lights.cameras[row] else state
