"""Turn signals that would have to be set before the turn before is done."""

from __future__ import annotations

import math
from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.tag_numbers import number_in
from percept.hdmap.elements import Lanelet

__all__ = ["TURN_SIGNAL_DISTANCE"]

_NAME = "mapping.intersection.turn_signal_distance_overlap"
_DEFAULT_DISTANCE_M = 15.0
_OPPOSITE = {"left": "right", "right": "left"}

_OVERLAP = IssueCode(
    "Intersection.TurnSignalDistanceOverlap-001",
    _NAME,
    "Error",
    "lanelet",
    "Set a turn_signal_distance that ends after the lanelet before; 0 where that is next to it",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        other = _OPPOSITE.get(lanelet.tags.get("turn_direction", ""))
        if other is None:
            continue
        distance = _distance_m(lanelet)
        before = [
            str(i)
            for i in _within(checked, lanelet_id, distance)
            if checked.hd_map.lanelets[i].tags.get("turn_direction") == other
        ]
        if before:
            what = f"has a turn_signal_distance of {distance:g} m, in which others turn {other}"
            yield _OVERLAP.at(lanelet_id, f"{what}: {', '.join(before)}")


def _distance_m(lanelet: Lanelet) -> float:
    """Return from where on a lanelet's turn is signalled; the default where it does not say."""
    distance = number_in(lanelet.tags.get("turn_signal_distance", ""))
    return _DEFAULT_DISTANCE_M if distance is None else distance


def _within(checked: CheckedMap, lanelet_id: int, distance_m: float) -> list[int]:
    """Return the lanelets that lead to one and lie all within a distance before it, ids rising."""
    routing, lanelets = checked.hd_map.routing, checked.hd_map.lanelets
    reach: dict[int, float] = {}
    ahead = [(lanelet_id, 0.0)]
    while ahead:
        current, covered = ahead.pop()
        for before in routing.previous_ids(current):
            total = covered + lanelets[before].length_m
            if total <= distance_m and total < reach.get(before, math.inf):
                reach[before] = total
                ahead.append((before, total))
    return sorted(reach)


TURN_SIGNAL_DISTANCE = Rule(
    name=_NAME,
    looks_for="Lanelets whose turn is signalled where a turn to the other side is not yet done",
    codes=(_OVERLAP,),
    find=_find,
)
