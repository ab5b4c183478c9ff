"""Lanelets of intersections: where they turn, by what they are bounded, that each is one piece."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_area import areas_covering
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule

__all__ = ["LANELET_BORDER_TYPE", "LANELET_DIVISION", "TURN_DIRECTION_TAGGING"]

_AREA_TAG = "intersection_area"

_TURNS = "mapping.intersection.turn_direction_tagging"
_DIRECTIONS = ("straight", "left", "right")
_SET_TURN = f"Set its tag turn_direction to one of {', '.join(_DIRECTIONS)}"
_NO_TURN = IssueCode("Intersection.TurnDirectionTagging-001", _TURNS, "Error", "lanelet", _SET_TURN)
_WRONG_TURN = IssueCode(
    "Intersection.TurnDirectionTagging-002", _TURNS, "Error", "lanelet", _SET_TURN
)


def _find_turns(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, areas in areas_covering(checked).items():
        turn = checked.hd_map.lanelets[lanelet_id].tags.get("turn_direction")
        place = f"lies in intersection area {areas[0]}"
        if turn is None:
            yield _NO_TURN.at(lanelet_id, f"{place}, but has no turn_direction")
        elif turn not in _DIRECTIONS:
            yield _WRONG_TURN.at(lanelet_id, f"{place}, but has turn_direction {turn!r}")


TURN_DIRECTION_TAGGING = Rule(
    name=_TURNS,
    looks_for="Lanelets in intersections that do not say where they turn",
    codes=(_NO_TURN, _WRONG_TURN),
    requirements=("vm-03-02",),
    find=_find_turns,
)

_BORDERS = "mapping.intersection.lanelet_border_type"
_BORDER_TYPES = ("virtual", "road_border")
_WRONG_BORDER = IssueCode(
    "Intersection.LaneletBorderType-001",
    _BORDERS,
    "Error",
    "lanelet",
    f"Set the type of its borders to {' or '.join(_BORDER_TYPES)}",
)


def _find_borders(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        if _AREA_TAG not in lanelet.tags:
            continue
        lines = (*lanelet.left_ids, *lanelet.right_ids)
        types = {line: checked.way_tags(line).get("type", "none") for line in lines}
        wrong = [f"{line} ({kind})" for line, kind in types.items() if kind not in _BORDER_TYPES]
        if wrong:
            what = f"is of an intersection, but has borders of other types: {', '.join(wrong)}"
            yield _WRONG_BORDER.at(lanelet_id, what)


LANELET_BORDER_TYPE = Rule(
    name=_BORDERS,
    looks_for="Lanelets of intersections with borders that are neither virtual nor road borders",
    codes=(_WRONG_BORDER,),
    requirements=("vm-03-02",),
    find=_find_borders,
)

_DIVISION = "mapping.intersection.lanelet_division"
_DIVIDED = IssueCode(
    "Intersection.LaneletDivision-001", _DIVISION, "Error", "lanelet", "Merge the two into one"
)


def _find_division(checked: CheckedMap) -> Iterator[MapIssue]:
    lanelets = checked.hd_map.lanelets
    for lanelet_id, lanelet in lanelets.items():
        area = lanelet.tags.get(_AREA_TAG)
        for after in checked.hd_map.routing.following_ids(lanelet_id) if area else ():
            if lanelets[after].tags.get(_AREA_TAG) == area:
                what = f"is followed by lanelet {after} of the same intersection area {area}"
                yield _DIVIDED.at(lanelet_id, what)


LANELET_DIVISION = Rule(
    name=_DIVISION,
    looks_for="Lanelets that go through one intersection in several pieces",
    codes=(_DIVIDED,),
    requirements=("vm-03-05",),
    find=_find_division,
)
