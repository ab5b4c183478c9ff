"""Road marks of OpenDRIVE in the words of Lanelet2."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lxml import etree

from percept.hdmap.opendrive.document import Numbers

__all__ = ["Mark", "read_mark"]

# Types as "solid broken" are told from the inside of the road to its outside; for lane 0 from
# left to right (OpenDRIVE 1.7, 9.6).
_TYPES = {
    "solid": "solid",
    "broken": "dashed",
    "solid solid": "solid_solid",
    "solid broken": "solid_dashed",
    "broken solid": "dashed_solid",
}
_EDGES = frozenset({"curb", "grass", "edge"})
_MIRRORED = {"solid_dashed": "dashed_solid", "dashed_solid": "solid_dashed"}


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark of a lane's outer border from a length on.

    Attributes:
        start: From the start of the lane section, metres.
        type: In the words of `MapMarking`; empty where there is nothing on the border.
        colour: In its words.
        painted: False for kerbs and edges.
        width_m: NaN where the map does not say.
        unknown: What the map calls it where no word of ours fits; otherwise empty.
    """

    start: float
    type: str
    colour: str
    painted: bool
    width_m: float
    unknown: str = ""


def read_mark(element: etree._Element, lane_id: int, numbers: Numbers) -> Mark:
    """Read a `roadMark` of a lane.

    Raises:
        InputError: If a number of it is none.
    """
    start = numbers.number(element, "sOffset", 0.0)
    word = element.get("type", "none").strip()
    if word == "none":
        return Mark(start, "", "unknown", painted=False, width_m=math.nan)
    painted = word not in _EDGES
    known = word in _TYPES or word in _EDGES
    kind = _TYPES.get(word, "unknown")
    colour = element.get("color", "standard")
    return Mark(
        start=start,
        type=_MIRRORED.get(kind, kind) if lane_id > 0 else kind,
        colour=("white" if colour == "standard" else colour) if painted else "unknown",
        painted=painted,
        width_m=_width(element, numbers),
        unknown="" if known else word[:40],
    )


def _width(element: etree._Element, numbers: Numbers) -> float:
    """Return the width of one line of a mark: that of its first line, or of the mark."""
    line = element.find("type/line")
    for said in (line, element):
        if said is not None and said.get("width") is not None:
            width = numbers.number(said, "width")
            return width if width > 0 else math.nan
    return math.nan
