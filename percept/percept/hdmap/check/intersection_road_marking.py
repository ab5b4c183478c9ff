"""Road markings: stop lines at which one slows down but need not stop."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule

__all__ = ["ROAD_MARKINGS"]

_NAME = "mapping.intersection.road_markings"
_MEMBERS = IssueCode(
    "Intersection.RoadMarkings-001",
    _NAME,
    "Error",
    "regulatory element",
    "Let it have the stop line as its only refers, and no ref_line",
)
_TYPE = IssueCode(
    "Intersection.RoadMarkings-002",
    _NAME,
    "Error",
    "linestring",
    "Set its type to stop_line, or refer to one that is",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of("road_marking"):
        refers, lines = checked.ways_in(rule, "refers"), checked.ways_in(rule, "ref_line")
        if len(refers) != 1 or lines:
            what = f"is a road marking with {len(refers)} refers and {len(lines)} ref_lines"
            yield _MEMBERS.at(rule.rule_id, what)
            continue
        kind = checked.way_tags(refers[0]).get("type", "none")
        if kind != "stop_line":
            yield _TYPE.at(refers[0], f"is of road marking {rule.rule_id}, but of type {kind}")


ROAD_MARKINGS = Rule(
    name=_NAME,
    looks_for="Road markings that are not about one stop line",
    codes=(_MEMBERS, _TYPE),
    requirements=("vm-03-14",),
    find=_find,
)
