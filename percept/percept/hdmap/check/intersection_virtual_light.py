"""Virtual traffic lights: of what lines they are made.

Where vehicles ask an infrastructure for leave to pass, a regulatory element says where: asked for
from the start line on, waited for at the stop line (`ref_line`), given back at the end line.
"""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.extent import far_apart
from percept.hdmap.check.issue import IssueCode, MapIssue, Primitive
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["VIRTUAL_LIGHT", "VIRTUAL_LIGHT_DETAILS", "coordinated_lights"]

VIRTUAL_LIGHT = "virtual_traffic_light"
"""Subtype of the regulatory elements of virtual traffic lights."""

_COORDINATION = "intersection_coordination"
_NAME = "mapping.intersection.regulatory_element_details_for_virtual_traffic_lights"
_PREFIX = "Intersection.RegulatoryElementDetailsForVirtualTrafficLights"
_REGULATION: Primitive = "regulatory element"


def coordinated_lights(checked: CheckedMap) -> tuple[RegulatoryElement, ...]:
    """Return the virtual traffic lights that coordinate an intersection, by ids rising.

    Others, such as those of gates and lifts, may be built in other ways.
    """
    return tuple(
        rule
        for rule in checked.rules_of(VIRTUAL_LIGHT)
        if any(
            checked.way_tags(way).get("type") == _COORDINATION
            for way in checked.ways_in(rule, "refers")
        )
    )


def _typed(number: int, role: str, kind: str) -> IssueCode:
    remedy = f"Let {role} be lines of type {kind}"
    return IssueCode(f"{_PREFIX}-{number:03d}", _NAME, "Error", "linestring", remedy)


_START_LINE = _typed(1, "start_line", "virtual")
_STOP_LINES = IssueCode(
    f"{_PREFIX}-002",
    _NAME,
    "Error",
    _REGULATION,
    "Give it one ref_line, and make one for each further stop line",
)
_STOP_LINE = _typed(3, "ref_line", "stop_line")
_END_LINE = _typed(4, "end_line", "virtual")
_NO_REFERS = IssueCode(
    f"{_PREFIX}-005",
    _NAME,
    "Error",
    _REGULATION,
    f"Let it refer to a line string of type {_COORDINATION}",
)
_REFERS = _typed(6, "refers", _COORDINATION)
_TOO_LARGE = IssueCode(
    f"{_PREFIX}-007",
    _NAME,
    "Warning",
    _REGULATION,
    "Remove members that have nothing to do with it, or split it",
)
_TYPES = (
    ("start_line", "virtual", _START_LINE),
    ("ref_line", "stop_line", _STOP_LINE),
    ("end_line", "virtual", _END_LINE),
    ("refers", _COORDINATION, _REFERS),
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of(VIRTUAL_LIGHT):
        for role, kind, code in _TYPES:
            for line in checked.ways_in(rule, role):
                found = checked.way_tags(line).get("type", "none")
                if found != kind:
                    what = f"is {role} of virtual traffic light {rule.rule_id}, but of type {found}"
                    yield code.at(line, what)
        stop_lines = checked.ways_in(rule, "ref_line")
        if len(stop_lines) != 1:
            what = f"is a virtual traffic light with {len(stop_lines)} ref_lines, not one"
            yield _STOP_LINES.at(rule.rule_id, what)
        if not checked.ways_in(rule, "refers"):
            yield _NO_REFERS.at(rule.rule_id, "is a virtual traffic light that refers to nothing")
        yield from far_apart(checked, rule, _TOO_LARGE)


VIRTUAL_LIGHT_DETAILS = Rule(
    name=_NAME,
    looks_for="Virtual traffic lights with missing, wrong or unrelated lines",
    codes=(_START_LINE, _STOP_LINES, _STOP_LINE, _END_LINE, _NO_REFERS, _REFERS, _TOO_LARGE),
    requirements=("vm-03-16",),
    find=_find,
)
