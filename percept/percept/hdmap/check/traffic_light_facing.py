"""Which way a traffic light faces: its line runs from left to right for whom it is for."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import Lanelet, RegulatoryElement

__all__ = ["TRAFFIC_LIGHT_FACING"]

_F64 = NDArray[np.float64]
_NAME = "mapping.traffic_light.correct_facing"
_LARGEST_SPREAD_RAD = math.radians(45.0)

_DIVERGENT = IssueCode(
    "TrafficLight.CorrectFacing-001",
    _NAME,
    "Info",
    "linestring",
    "See that each of the lanelets is one from which the light is seen",
)
_WRONG = IssueCode(
    "TrafficLight.CorrectFacing-002",
    _NAME,
    "Error",
    "linestring",
    "Draw it from left to right as it is seen from the stop line",
)
_BOTH = IssueCode(
    "TrafficLight.CorrectFacing-003",
    _NAME,
    "Warning",
    "linestring",
    "See for whom it is, and draw it from left to right as they see it",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    verdicts: defaultdict[int, set[bool]] = defaultdict(set)
    for rule in checked.rules_of("traffic_light"):
        crossings = _crossings(checked, rule)
        for light in _lights_of(checked, rule) if crossings else ():
            # A line that ends where it begins, as a closed outline does, faces nowhere.
            if not (span := _span(checked.hd_map.points_of(light))).any():
                continue
            yield from _divergent(light, crossings)
            first = next(iter(crossings.values()))
            verdicts[light].add(bool(span @ first > 0))
    for light, verdict in verdicts.items():
        if verdict == {False}:
            yield _WRONG.at(light, "is a traffic light that is seen from right to left")
        elif len(verdict) == 2:
            yield _BOTH.at(light, "is a traffic light that some see from left to right, others not")


def _lights_of(checked: CheckedMap, rule: RegulatoryElement) -> Sequence[int]:
    """Return the lights for vehicles that a rule refers to; those for pedestrians face anywhere."""
    lights = [(light, checked.way_tags(light)) for light in checked.ways_in(rule, "refers")]
    return [
        light
        for light, tags in lights
        if tags.get("type") == "traffic_light" and tags.get("subtype") == "red_yellow_green"
    ]


def _divergent(light: int, crossings: Mapping[int, _F64]) -> Iterator[MapIssue]:
    """Yield one issue for each lanelet that crosses the stop line another way than the first."""
    (first, base), *others = crossings.items()
    for lanelet, crossing in others:
        angle = math.acos(np.clip(base @ crossing / _length(base) / _length(crossing), -1.0, 1.0))
        if angle > _LARGEST_SPREAD_RAD:
            what = f"is a traffic light of lanelets {first} and {lanelet}"
            yield _DIVERGENT.at(
                light, f"{what}, which begin {math.degrees(angle):.0f} degrees apart"
            )


def _crossings(checked: CheckedMap, rule: RegulatoryElement) -> Mapping[int, _F64]:
    """Return by lanelet of a rule the step (3,) from left to right at its end by the stop line.

    None without a stop line, which is what `regulatory_element_details` reports.
    """
    lines = checked.ways_in(rule, "ref_line")
    if not lines:
        return {}
    stop_line = checked.hd_map.points_of(lines[0])
    lanelets = (checked.hd_map.lanelets[i] for i in checked.lanelets_under(rule.rule_id))
    steps = {lanelet.lanelet_id: _step_at(lanelet, stop_line) for lanelet in lanelets}
    return {lanelet: step for lanelet, step in steps.items() if _length(step) > 0}


def _step_at(lanelet: Lanelet, line: _F64) -> _F64:
    """Return the step (3,) from left to right border at the end of a lanelet next to a line."""
    begin = np.stack([lanelet.left_map[0], lanelet.right_map[0]])
    end = np.stack([lanelet.left_map[-1], lanelet.right_map[-1]])
    left, right = begin if _apart(begin, line) <= _apart(end, line) else end
    step: _F64 = right - left
    return step


def _apart(pair: _F64, line: _F64) -> float:
    """Return how far two points (2, 3) lie from the ends of a line, whichever way it runs."""
    ends = line[[0, -1]]
    ways = (np.linalg.norm(pair - order, axis=1).sum() for order in (ends, ends[::-1]))
    return float(min(ways))


def _span(line: _F64) -> _F64:
    step: _F64 = line[-1] - line[0]
    return step


def _length(step: _F64) -> float:
    return float(np.linalg.norm(step))


TRAFFIC_LIGHT_FACING = Rule(
    name=_NAME,
    looks_for="Traffic lights for vehicles that are drawn from right to left",
    codes=(_DIVERGENT, _WRONG, _BOTH),
    requirements=("vm-04-02",),
    find=_find,
)
