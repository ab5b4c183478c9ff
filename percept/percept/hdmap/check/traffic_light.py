"""Traffic lights: the body's height, the bulbs' colours, and regulatory elements about them."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue, Primitive
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.tag_numbers import number_in

__all__ = ["BODY_HEIGHT", "LIGHT_BULBS", "MISSING_REFERRERS", "MISSING_REGULATORY_ELEMENTS"]

_KIND = "traffic_light"
_REGULATION: Primitive = "regulatory element"

_HEIGHT = "mapping.traffic_light.body_height"
_LOWEST_M, _HIGHEST_M = 0.2, 2.0
_NO_HEIGHT = IssueCode(
    "TrafficLight.BodyHeight-001",
    _HEIGHT,
    "Error",
    "linestring",
    "Add the tag height: the height of the light's body in metres",
)
_WRONG_HEIGHT = IssueCode(
    "TrafficLight.BodyHeight-002",
    _HEIGHT,
    "Error",
    "linestring",
    f"Set the height of the light's body in metres, {_LOWEST_M:g} to {_HIGHEST_M:g}",
)


def _find_heights(checked: CheckedMap) -> Iterator[MapIssue]:
    for light in checked.ways_of(_KIND):
        text = checked.way_tags(light).get("height")
        if text is None:
            yield _NO_HEIGHT.at(light, "is a traffic light without a height")
            continue
        height = number_in(text)
        if height is None or not _LOWEST_M <= height <= _HIGHEST_M:
            yield _WRONG_HEIGHT.at(light, f"is a traffic light of height {text!r}")


BODY_HEIGHT = Rule(
    name=_HEIGHT,
    looks_for="Traffic lights without a height, or of one that no light has",
    codes=(_NO_HEIGHT, _WRONG_HEIGHT),
    requirements=("vm-04-02",),
    find=_find_heights,
)

_BULBS = "mapping.traffic_light.light_bulb_tagging"
_COLOURS = ("red", "yellow", "green")
_ARROWS = ("up", "right", "left", "up_right", "up_left")
_SET_COLOUR = f"Set the tag color to one of {', '.join(_COLOURS)}"
_NO_COLOUR = IssueCode("TrafficLight.LightBulbTagging-001", _BULBS, "Error", "point", _SET_COLOUR)
_WRONG_COLOUR = IssueCode(
    "TrafficLight.LightBulbTagging-002", _BULBS, "Error", "point", _SET_COLOUR
)
_WRONG_ARROW = IssueCode(
    "TrafficLight.LightBulbTagging-003",
    _BULBS,
    "Error",
    "point",
    f"Set the tag arrow to one of {', '.join(_ARROWS)}, or remove it from a round bulb",
)


def _find_bulbs(checked: CheckedMap) -> Iterator[MapIssue]:
    rules = checked.hd_map.rules.values()
    lines = sorted({line for rule in rules for line in checked.ways_in(rule, "light_bulbs")})
    for line in lines:
        for bulb in checked.hd_map.line_strings[line].nodes:
            tags = checked.hd_map.point_tags.get(bulb, {})
            colour, arrow = tags.get("color"), tags.get("arrow")
            if colour is None:
                yield _NO_COLOUR.at(bulb, f"is a bulb of line string {line} without a color")
            elif colour not in _COLOURS:
                yield _WRONG_COLOUR.at(bulb, f"is a bulb of line string {line} of color {colour!r}")
            if arrow is not None and arrow not in _ARROWS:
                yield _WRONG_ARROW.at(bulb, f"is a bulb of line string {line} of arrow {arrow!r}")


LIGHT_BULBS = Rule(
    name=_BULBS,
    looks_for="Bulbs of traffic lights without a colour, or of a colour or arrow that no light has",
    codes=(_NO_COLOUR, _WRONG_COLOUR, _WRONG_ARROW),
    requirements=("vm-04-03",),
    find=_find_bulbs,
)

_REFERRERS = "mapping.traffic_light.missing_referrers"
_NO_REFERRER = IssueCode(
    "TrafficLight.MissingReferrers-001",
    _REFERRERS,
    "Error",
    _REGULATION,
    "Let the lanelets that the light is for refer to it",
)


def _find_referrers(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of(_KIND):
        if not checked.lanelets_under(rule.rule_id):
            yield _NO_REFERRER.at(
                rule.rule_id, "is about a traffic light that holds for no lanelet"
            )


MISSING_REFERRERS = Rule(
    name=_REFERRERS,
    looks_for="Regulatory elements of traffic lights that no lanelet refers to",
    codes=(_NO_REFERRER,),
    requirements=("vm-04-01",),
    find=_find_referrers,
)

_REGULATIONS = "mapping.traffic_light.missing_regulatory_elements"
_NO_REGULATION = IssueCode(
    "TrafficLight.MissingRegulatoryElements-001",
    _REGULATIONS,
    "Error",
    "linestring",
    "Add a regulatory element of subtype traffic_light that refers to it",
)


def _find_regulations(checked: CheckedMap) -> Iterator[MapIssue]:
    for light in checked.ways_of(_KIND):
        if not checked.is_referred(light, by=_KIND):
            yield _NO_REGULATION.at(
                light, "is a traffic light that no regulatory element refers to"
            )


MISSING_REGULATORY_ELEMENTS = Rule(
    name=_REGULATIONS,
    looks_for="Traffic lights that no regulatory element refers to",
    codes=(_NO_REGULATION,),
    requirements=("vm-04-01",),
    find=_find_regulations,
)
