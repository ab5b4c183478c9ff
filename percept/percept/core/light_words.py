"""What the class names of light detectors say."""

from __future__ import annotations

import re
from enum import IntEnum

__all__ = ["Reading", "light_label"]


class Reading(IntEnum):
    """What one box says of a light.

    `UNREADABLE` is a light whose lamps the detector does not tell: it says where the light is and
    nothing of its state, which is not the same as `DARK`, a housing seen with no lamp lit.
    """

    RED = 0
    YELLOW = 1
    GREEN = 2
    DARK = 3
    UNREADABLE = 4


_COLOURS = {
    "red": Reading.RED,
    "yellow": Reading.YELLOW,
    "amber": Reading.YELLOW,
    "green": Reading.GREEN,
    "off": Reading.DARK,
    "dark": Reading.DARK,
}
_FILLERS = frozenset({"traffic", "light", "tl", "left", "right", "straight", "arrow", "round"})
_UNREAD = frozenset({"traffic light", "light unknown", "traffic light unknown"})
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


def light_label(label: str) -> Reading | None:
    """Return what a class name says of a traffic light, or None if it names no light.

    A colour or `off` with nothing beside it but words of lights and arrows: `light_red`, `Red`,
    `RedStraightLeft`, `traffic_light-off`. Arrows keep their colour; where they point is not
    kept. `traffic light` alone says nothing of the state. A `red car` is no light, and neither
    are lights for pedestrians, which follow other rules.
    """
    words = [word.lower() for word in _WORD.findall(label)]
    if " ".join(words) in _UNREAD:
        return Reading.UNREADABLE
    colours = [_COLOURS[word] for word in words if word in _COLOURS]
    if len(colours) != 1 or len(words) - 1 != sum(word in _FILLERS for word in words):
        return None
    return colours[0]
