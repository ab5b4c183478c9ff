"""Right of way under traffic lights: turns yield to what may have green when they have not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_conflict import Conflict, have_same_source
from percept.hdmap.check.intersection_yields import (
    RIGHT_OF_WAY,
    YieldCodes,
    about_yields,
    is_owner,
)
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import Lanelet

__all__ = ["RIGHT_OF_WAY_WITH_LIGHTS"]

_F64 = NDArray[np.float64]
_NAME = "mapping.intersection.right_of_way_with_traffic_lights"
_PREFIX = "Intersection.RightOfWayWithTrafficLights"
_LIGHT = "traffic_light"
_SAME_PHASE_RAD = np.deg2rad(45.0)

_NONE = IssueCode(
    f"{_PREFIX}-001",
    _NAME,
    "Error",
    "lanelet",
    "Refer to a regulatory element of subtype right_of_way with its yields",
)
_MANY = IssueCode(
    f"{_PREFIX}-002",
    _NAME,
    "Error",
    "lanelet",
    "Keep one regulatory element of subtype right_of_way, with all yields",
)
_OTHER = IssueCode(
    f"{_PREFIX}-003",
    _NAME,
    "Error",
    "regulatory element",
    "Give the lanelet its own regulatory element, with it as right_of_way",
)
_YIELDS = YieldCodes.numbered(_NAME, _PREFIX, (4, 5, 6), "Error")


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    # Who drives straight on has priority: only turns have to name their yields.
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        turn = lanelet.tags.get("turn_direction")
        if turn not in ("left", "right") or not checked.rules_for(lanelet, _LIGHT):
            continue
        rules = checked.rules_for(lanelet, RIGHT_OF_WAY)
        if not rules:
            yield _NONE.at(
                lanelet_id, f"turns {turn} under traffic lights, but has no right_of_way"
            )
        elif len(rules) > 1:
            yield _MANY.at(lanelet_id, f"has {len(rules)} regulatory elements right_of_way")
        elif not is_owner(checked, rules[0], lanelet_id):
            what = f"is named by lanelet {lanelet_id}, but does not have it as right_of_way"
            yield _OTHER.at(rules[0].rule_id, what)
        else:
            needs = _Turn(checked, lanelet).yields_to
            yield from about_yields(checked, rules[0], lanelet_id, needs, _YIELDS)


@dataclass(frozen=True, slots=True)
class _Turn:
    """A turn under traffic lights."""

    checked: CheckedMap
    lanelet: Lanelet

    def yields_to(self, conflict: Conflict) -> bool:
        """Return whether it yields to a lanelet that crosses it.

        It does if that may have green when it has not, or turns right where it turns left, as is
        the rule where one keeps left; not if both come from one lanelet.
        """
        if have_same_source(self.checked, self.lanelet.lanelet_id, conflict.lanelet_id):
            return False
        other = self.checked.hd_map.lanelets[conflict.lanelet_id]
        turns = (self.lanelet.tags["turn_direction"], other.tags.get("turn_direction"))
        return turns == ("left", "right") or not _share_phase(self.checked, self.lanelet, other)


def _share_phase(checked: CheckedMap, one: Lanelet, other: Lanelet) -> bool:
    """Return whether the lights of two lanelets face along one road, one way or the other.

    Such lights have green together. False where a lanelet has no light.
    """
    first, second = _light_direction(checked, one), _light_direction(checked, other)
    if first is None or second is None:
        return False
    return bool(abs(first @ second) > np.cos(_SAME_PHASE_RAD))


def _light_direction(checked: CheckedMap, lanelet: Lanelet) -> _F64 | None:
    """Return the direction (2,) of the line of a lanelet's first light; None without one."""
    lights = [
        light
        for rule in checked.rules_for(lanelet, _LIGHT)
        for light in checked.ways_in(rule, "refers")
    ]
    if not lights:
        return None
    points = checked.hd_map.points_of(lights[0])
    step = points[-1, :2] - points[0, :2]
    length = float(np.linalg.norm(step))
    direction: _F64 | None = step / length if length else None
    return direction


RIGHT_OF_WAY_WITH_LIGHTS = Rule(
    name=_NAME,
    looks_for="Turns under traffic lights that yield to the wrong lanelets",
    codes=(_NONE, _MANY, _OTHER, _YIELDS.missing, _YIELDS.needless, _YIELDS.slight),
    requirements=("vm-03-10",),
    find=_find,
)
