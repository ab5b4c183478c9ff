"""Right of way where no traffic light says who goes first, and under virtual traffic lights."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.area import polygons_of
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_conflict import Conflict, have_same_source
from percept.hdmap.check.intersection_virtual_light import VIRTUAL_LIGHT
from percept.hdmap.check.intersection_yields import (
    RIGHT_OF_WAY,
    OwnerCodes,
    YieldCodes,
    about_owner,
    about_yields,
)
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["RIGHT_OF_WAY_WITHOUT_LIGHTS", "RIGHT_OF_WAY_WITH_VIRTUAL_LIGHTS"]

_BARE = "mapping.intersection.right_of_way_without_traffic_lights"
_BARE_PREFIX = "Intersection.RightOfWayWithoutTrafficLights"
_BARE_OWNER = OwnerCodes.numbered(_BARE, _BARE_PREFIX, (1, 2))
_BARE_YIELDS = YieldCodes.numbered(_BARE, _BARE_PREFIX, (3, 4, 6), "Warning")
_NO_RIGHT_OF_WAY = IssueCode(
    f"{_BARE_PREFIX}-005",
    _BARE,
    "Error",
    "polygon",
    "Add a regulatory element of subtype right_of_way for the lanelets in it that cross others",
)


def _find_bare(checked: CheckedMap) -> Iterator[MapIssue]:
    unregulated: dict[str, bool] = {}
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        area = lanelet.tags.get("intersection_area")
        rules = checked.rules_for(lanelet, RIGHT_OF_WAY)
        if area is not None:
            unregulated[area] = unregulated.get(area, True) and not rules
        elif "turn_direction" not in lanelet.tags:
            continue
        if not checked.rules_for(lanelet, "traffic_light", VIRTUAL_LIGHT):
            for rule in rules:
                yield from _about_bare(checked, rule, lanelet_id)
    for polygon in polygons_of(checked, "intersection_area"):
        if unregulated.get(str(polygon), False):
            yield _NO_RIGHT_OF_WAY.at(polygon, "is an intersection without any right_of_way")


def _about_bare(
    checked: CheckedMap, rule: RegulatoryElement, lanelet_id: int
) -> Iterator[MapIssue]:
    def needs(conflict: Conflict) -> bool:
        return not have_same_source(checked, lanelet_id, conflict.lanelet_id)

    wrong = list(about_owner(checked, rule, lanelet_id, _BARE_OWNER))
    yield from wrong or about_yields(checked, rule, lanelet_id, needs, _BARE_YIELDS)


RIGHT_OF_WAY_WITHOUT_LIGHTS = Rule(
    name=_BARE,
    looks_for="Lanelets of intersections without lights that yield to the wrong lanelets",
    codes=(
        _BARE_OWNER.count,
        _BARE_OWNER.other,
        _BARE_YIELDS.missing,
        _BARE_YIELDS.needless,
        _NO_RIGHT_OF_WAY,
        _BARE_YIELDS.slight,
    ),
    requirements=("vm-03-11",),
    find=_find_bare,
)

_VIRTUAL = "mapping.intersection.right_of_way_for_virtual_traffic_lights"
_VIRTUAL_PREFIX = "Intersection.RightOfWayForVirtualTrafficLights"
_NONE = IssueCode(
    f"{_VIRTUAL_PREFIX}-001",
    _VIRTUAL,
    "Error",
    "lanelet",
    "Refer to a regulatory element of subtype right_of_way with its yields",
)
_MANY = IssueCode(
    f"{_VIRTUAL_PREFIX}-002",
    _VIRTUAL,
    "Error",
    "lanelet",
    "Keep one regulatory element of subtype right_of_way, with all yields",
)
_VIRTUAL_OWNER = OwnerCodes.numbered(_VIRTUAL, _VIRTUAL_PREFIX, (3, 4))
_VIRTUAL_YIELDS = YieldCodes.numbered(_VIRTUAL, _VIRTUAL_PREFIX, (5, 6, 7), "Error")


def _find_virtual(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        if not checked.rules_for(lanelet, VIRTUAL_LIGHT):
            continue
        rules = checked.rules_for(lanelet, RIGHT_OF_WAY)
        if not rules:
            yield _NONE.at(lanelet_id, "has a virtual traffic light, but no right_of_way")
        elif len(rules) > 1:
            yield _MANY.at(lanelet_id, f"has {len(rules)} regulatory elements right_of_way")
        else:
            yield from _about_virtual(checked, rules[0], lanelet_id)


def _about_virtual(
    checked: CheckedMap, rule: RegulatoryElement, lanelet_id: int
) -> Iterator[MapIssue]:
    def needs(conflict: Conflict) -> bool:
        # Leave to pass is asked for against all that crosses, wherever that comes from.
        del conflict
        return True

    wrong = list(about_owner(checked, rule, lanelet_id, _VIRTUAL_OWNER))
    yield from wrong or about_yields(checked, rule, lanelet_id, needs, _VIRTUAL_YIELDS)


RIGHT_OF_WAY_WITH_VIRTUAL_LIGHTS = Rule(
    name=_VIRTUAL,
    looks_for="Lanelets under virtual traffic lights that yield to the wrong lanelets",
    codes=(
        _NONE,
        _MANY,
        _VIRTUAL_OWNER.count,
        _VIRTUAL_OWNER.other,
        _VIRTUAL_YIELDS.missing,
        _VIRTUAL_YIELDS.needless,
        _VIRTUAL_YIELDS.slight,
    ),
    requirements=("vm-03-17",),
    find=_find_virtual,
)
