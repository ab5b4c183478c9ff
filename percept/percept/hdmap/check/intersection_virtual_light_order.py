"""The order of a virtual traffic light's lines: start line, stop line, end line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import shapely
from shapely import LineString

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_virtual_light import coordinated_lights
from percept.hdmap.check.intersection_virtual_light_section import (
    Track,
    end_line_on,
    lanelets_below,
    path_between,
    share_on,
)
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["VIRTUAL_LIGHT_ORDER"]

_NAME = "mapping.intersection.virtual_traffic_light_line_order"
_PREFIX = "Intersection.VirtualTrafficLightLineOrder"
_LEAST_SHARE = 0.1
"""Share of a stop line on the way from which on it counts as placed there: some span a road."""

_START = "Place the start_line across a lanelet that leads to those that the light is for"
_NOWHERE = IssueCode(f"{_PREFIX}-001", _NAME, "Error", "linestring", _START)
_NO_END = IssueCode(
    f"{_PREFIX}-002",
    _NAME,
    "Error",
    "regulatory element",
    "Place an end_line across each lanelet that the light is for",
)
_INSIDE = IssueCode(f"{_PREFIX}-003", _NAME, "Error", "linestring", _START)
_NO_WAY = IssueCode(f"{_PREFIX}-004", _NAME, "Error", "regulatory element", _START)
_OFF_WAY = IssueCode(
    f"{_PREFIX}-005",
    _NAME,
    "Error",
    "linestring",
    "Place the stop line across the way from the start_line to the end_line",
)
_ORDER = IssueCode(
    f"{_PREFIX}-006",
    _NAME,
    "Error",
    "regulatory element",
    "Place start_line, stop line and end_line in this order, square to the way",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in coordinated_lights(checked):
        lines = checked.ways_in(rule, "start_line")
        start = checked.line(lines[0]) if len(lines) == 1 else None
        if start is None:
            what = f"has {len(lines)} start_lines, not one from which a way could begin"
            yield _NO_WAY.at(rule.rule_id, what)
            continue
        lanelets = lanelets_below(checked, start)
        if not lanelets:
            what = f"is start_line of virtual traffic light {rule.rule_id}, but on no lanelet"
            yield _NOWHERE.at(lines[0], what)
            continue
        targets = checked.lanelets_under(rule.rule_id)
        ends = {target: end_line_on(checked, rule, target) for target in targets}
        for target in [target for target, end in ends.items() if end is None]:
            yield _NO_END.at(rule.rule_id, f"has no end_line on lanelet {target} that it is for")
        touched = [t for t in targets if start.intersects(checked.lanelet_ground(t))]
        if touched:
            names = ", ".join(map(str, touched))
            what = f"is start_line of virtual traffic light {rule.rule_id}, but on its lanelets"
            yield _INSIDE.at(lines[0], f"{what}: {names}")
            continue
        for target, end in ends.items():
            if end is not None:
                yield from _about_way(checked, rule, (start, lanelets), target, end)


def _about_way(
    checked: CheckedMap,
    rule: RegulatoryElement,
    start: tuple[LineString, Sequence[int]],
    target: int,
    end: int,
) -> Iterator[MapIssue]:
    """Yield what is wrong on the way from a start line and its lanelets to one end line."""
    path = path_between(checked, start[1], target)
    if not path:
        what = f"has an end_line {end} on lanelet {target} to which its start_line does not lead"
        yield _NO_WAY.at(rule.rule_id, what)
        return
    stops, end_line = checked.ways_in(rule, "ref_line"), checked.line(end)
    stop = checked.line(stops[0]) if stops else None
    if stop is None or end_line is None:
        return
    ground = shapely.union_all([checked.lanelet_ground(lanelet) for lanelet in path])
    if share_on(stop, ground) < _LEAST_SHARE:
        what = f"is stop line of virtual traffic light {rule.rule_id}, but not on the way"
        yield _OFF_WAY.at(stops[0], f"{what} to its end_line {end}")
        return
    track = Track.along(checked, path)
    first, second, third = (track.place(line) for line in (start[0], stop, end_line))
    if not ((first < second).all() and (second < third).all()):
        what = f"has start line, stop line {stops[0]} and end line {end} in another order"
        yield _ORDER.at(rule.rule_id, what)


VIRTUAL_LIGHT_ORDER = Rule(
    name=_NAME,
    looks_for="Virtual traffic lights whose lines do not follow each other on one way",
    codes=(_NOWHERE, _NO_END, _INSIDE, _NO_WAY, _OFF_WAY, _ORDER),
    requirements=("vm-03-16",),
    find=_find,
)
