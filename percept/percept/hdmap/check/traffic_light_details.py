"""What a regulatory element of a traffic light has to be made of."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.extent import far_apart
from percept.hdmap.check.issue import IssueCode, MapIssue, Primitive
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import RegulatoryElement

__all__ = ["TRAFFIC_LIGHT_DETAILS"]

_NAME = "mapping.traffic_light.regulatory_element_details"
_PREFIX = "TrafficLight.RegulatoryElementDetails"
_REGULATION: Primitive = "regulatory element"
_PAIRS = "Refer to each light and to its bulbs, whose traffic_light_id is the light's id"

_NO_STOP_LINE = IssueCode(
    f"{_PREFIX}-001", _NAME, "Error", _REGULATION, "Give it a ref_line, the stop line of the light"
)
_NO_LIGHT = IssueCode(
    f"{_PREFIX}-002", _NAME, "Error", "linestring", "Let refers be lines of type traffic_light"
)
_NO_LINE = IssueCode(
    f"{_PREFIX}-003", _NAME, "Error", "linestring", "Let the ref_line be a line of type stop_line"
)
_NO_BULBS = IssueCode(
    f"{_PREFIX}-004", _NAME, "Error", "linestring", "Let light_bulbs be lines of type light_bulbs"
)
_UNPAIRED = IssueCode(
    f"{_PREFIX}-005",
    _NAME,
    "Info",
    "linestring",
    "Add the tag traffic_light_id: the id of the light that the bulbs belong to",
)
_COUNTS = IssueCode(f"{_PREFIX}-006", _NAME, "Info", _REGULATION, _PAIRS)
_NOT_PAIRS = IssueCode(f"{_PREFIX}-007", _NAME, "Info", _REGULATION, _PAIRS)
_TOO_LARGE = IssueCode(
    f"{_PREFIX}-008",
    _NAME,
    "Warning",
    _REGULATION,
    "Remove members that have nothing to do with the light, or split it",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of("traffic_light"):
        yield from _stop_line(checked, rule)
        yield from _members(checked, rule, "refers", "traffic_light", _NO_LIGHT)
        yield from _members(checked, rule, "ref_line", "stop_line", _NO_LINE)
        yield from _members(checked, rule, "light_bulbs", "light_bulbs", _NO_BULBS)
        yield from _pairs(checked, rule)
        yield from far_apart(checked, rule, _TOO_LARGE)


def _stop_line(checked: CheckedMap, rule: RegulatoryElement) -> Iterator[MapIssue]:
    """Yield elements without a stop line, but for those of pedestrians, who need none."""
    if checked.ways_in(rule, "ref_line"):
        return
    lights = checked.ways_in(rule, "refers")
    lanelets = checked.lanelets_under(rule.rule_id)
    red_green = [checked.way_tags(light).get("subtype") == "red_green" for light in lights]
    crosswalks = [checked.hd_map.lanelets[i].subtype == "crosswalk" for i in lanelets]
    if not (lights and all(red_green)) and not (lanelets and all(crosswalks)):
        yield _NO_STOP_LINE.at(rule.rule_id, "is about a traffic light without a stop line")


def _members(
    checked: CheckedMap, rule: RegulatoryElement, role: str, kind: str, code: IssueCode
) -> Iterator[MapIssue]:
    """Yield members of a role that are of another type."""
    for member in checked.ways_in(rule, role):
        found = checked.way_tags(member).get("type", "none")
        if found != kind:
            yield code.at(
                member, f"is {role} of traffic light rule {rule.rule_id}, but of type {found}"
            )


def _pairs(checked: CheckedMap, rule: RegulatoryElement) -> Iterator[MapIssue]:
    """Yield what keeps lights and bulbs from belonging to each other one to one."""
    lights = checked.ways_in(rule, "refers")
    bulbs = checked.ways_in(rule, "light_bulbs")
    owners = [checked.way_tags(line).get("traffic_light_id") for line in bulbs]
    for line, owner in zip(bulbs, owners, strict=True):
        if owner is None:
            what = f"is of traffic light rule {rule.rule_id}, but has no traffic_light_id"
            yield _UNPAIRED.at(line, what)
    if len(lights) != len(bulbs):
        what = f"refers to {len(lights)} lights, but to the bulbs of {len(bulbs)}"
        yield _COUNTS.at(rule.rule_id, what)
    elif sorted(owner or "" for owner in owners) != sorted(map(str, lights)):
        yield _NOT_PAIRS.at(rule.rule_id, "refers to bulbs that belong to other lights than it has")


TRAFFIC_LIGHT_DETAILS = Rule(
    name=_NAME,
    looks_for="Regulatory elements of traffic lights with missing, wrong or unrelated members",
    codes=(
        _NO_STOP_LINE,
        _NO_LIGHT,
        _NO_LINE,
        _NO_BULBS,
        _UNPAIRED,
        _COUNTS,
        _NOT_PAIRS,
        _TOO_LARGE,
    ),
    requirements=("vm-04-01",),
    find=_find,
)
