"""Polygons that a map draws on the ground, and whether they are drawn soundly."""

from __future__ import annotations

import shapely

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.participants import truth

__all__ = ["flaw_of", "is_polygon", "polygons_of"]

_TOO_FEW = "has less than three points"


def is_polygon(checked: CheckedMap, way_id: int) -> bool:
    """Return whether a way is a polygon: Lanelet2 takes those for one that say `area=yes`."""
    return truth(checked.way_tags(way_id).get("area")) is True


def polygons_of(checked: CheckedMap, kind: str) -> tuple[int, ...]:
    """Return polygons by the tag `type`, ids rising."""
    return tuple(i for i in checked.ways_of(kind) if is_polygon(checked, i))


def flaw_of(checked: CheckedMap, way_id: int) -> str | None:
    """Return what is wrong with a polygon's outline as a clause; None where it is sound.

    A sound one has at least three different points and neither crosses nor touches itself, as OGC
    Simple Features 1.2.1, 6.1.11, have it. Which way round it is drawn does not matter.
    """
    outline = checked.outline(way_id)
    if outline is None:
        return _TOO_FEW
    if outline.is_valid:
        return None
    reason, _, place = shapely.is_valid_reason(outline).rstrip("]").partition("[")
    if "self-intersection" in reason.lower():
        x, y = (float(text) for text in place.split()[:2])
        return f"crosses or touches itself at {x:.2f}, {y:.2f}"
    return _TOO_FEW if "too few" in reason.lower() else "has no sound outline"
