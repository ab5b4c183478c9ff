"""Rules on crosswalks, and on the regulatory elements that make vehicles give way at them."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.extent import far_apart
from percept.hdmap.check.issue import IssueCode, MapIssue, listed
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.tag_numbers import number_in
from percept.hdmap.elements import Lanelet, RegulatoryElement

__all__ = [
    "CROSSWALK_DETAILS",
    "CROSSWALK_MISSING_REGULATORY_ELEMENTS",
    "CROSSWALK_SAFETY_ATTRIBUTES",
]

_SAFETY = "mapping.crosswalk.safety_attributes"
_NO_SPEED = IssueCode(
    "Crosswalk.SafetyAttributes-001", _SAFETY, "Error", "lanelet",
    "Write safety_slow_down_speed as a number over 0, without a unit",
)  # fmt: skip
_NO_DISTANCE = IssueCode(
    "Crosswalk.SafetyAttributes-002", _SAFETY, "Error", "lanelet",
    "Write safety_slow_down_distance as a number over 0, without a unit",
)  # fmt: skip

_MISSING = "mapping.crosswalk.missing_regulatory_elements"
_NO_RULE = IssueCode(
    "Crosswalk.MissingRegulatoryElements-001", _MISSING, "Error", "lanelet",
    "Add a regulatory element of subtype crosswalk that refers to it",
)  # fmt: skip

_DETAILS = "mapping.crosswalk.regulatory_element_details"
_NO_CROSSWALK = IssueCode(
    "Crosswalk.RegulatoryElementDetails-001", _DETAILS, "Error", "regulatory element",
    "Add the lanelet of the crosswalk with the role refers",
)  # fmt: skip
_TWO_CROSSWALKS = IssueCode(
    "Crosswalk.RegulatoryElementDetails-002", _DETAILS, "Error", "regulatory element",
    "Keep one, and give each of the others a regulatory element of its own",
)  # fmt: skip
_NO_LINE = IssueCode(
    "Crosswalk.RegulatoryElementDetails-003", _DETAILS, "Info", "regulatory element",
    "Add the stop line with the role ref_line, if there is one on the road",
)  # fmt: skip
_TWO_LINES = IssueCode(
    "Crosswalk.RegulatoryElementDetails-009", _DETAILS, "Error", "regulatory element",
    "Keep one, and give each of the others a regulatory element of its own",
)  # fmt: skip
_NOT_A_CROSSWALK = IssueCode(
    "Crosswalk.RegulatoryElementDetails-006", _DETAILS, "Error", "lanelet",
    "Refer to a lanelet of subtype crosswalk",
)  # fmt: skip
_NOT_A_LINE = IssueCode(
    "Crosswalk.RegulatoryElementDetails-007", _DETAILS, "Error", "linestring",
    "Refer to a line string of type stop_line",
)  # fmt: skip
_NOBODY_WALKS = IssueCode(
    "Crosswalk.RegulatoryElementDetails-010", _DETAILS, "Error", "lanelet",
    "Set its tag participant:pedestrian to yes",
)  # fmt: skip
_NOBODY_MAY_WALK = IssueCode(
    "Crosswalk.RegulatoryElementDetails-011", _DETAILS, "Error", "lanelet",
    "Set its tag participant:pedestrian to yes",
)  # fmt: skip
_ELSEWHERE = IssueCode(
    "Crosswalk.RegulatoryElementDetails-012", _DETAILS, "Error", "regulatory element",
    "Take it from the lanelet, or correct the shapes of the two",
)  # fmt: skip
_FAR_APART = IssueCode(
    "Crosswalk.RegulatoryElementDetails-013", _DETAILS, "Warning", "regulatory element",
    "Remove the members that do not belong to it",
)  # fmt: skip


def _safety_attributes(checked: CheckedMap) -> Iterator[MapIssue]:
    keys = (("safety_slow_down_speed", _NO_SPEED), ("safety_slow_down_distance", _NO_DISTANCE))
    for crosswalk in checked.lanelets_of("crosswalk"):
        for key, code in keys:
            word = crosswalk.tags.get(key)
            number = None if word is None else number_in(word)
            if word is not None and (number is None or number <= 0):
                yield code.at(
                    crosswalk.lanelet_id, f"has {key}='{word}', which is no number over 0"
                )


def _missing_regulatory_elements(checked: CheckedMap) -> Iterator[MapIssue]:
    for crosswalk in checked.lanelets_of("crosswalk"):
        rules = checked.rules_about("relation", crosswalk.lanelet_id)
        if not any(rule.subtype == "crosswalk" for rule in rules):
            yield _NO_RULE.at(
                crosswalk.lanelet_id,
                "is a crosswalk that no regulatory element of subtype crosswalk refers to",
            )


def _regulatory_element_details(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of("crosswalk"):
        yield from _members(checked, rule)
        for lanelet_id in checked.lanelets_in(rule, "refers"):
            lanelet = checked.hd_map.lanelets[lanelet_id]
            yield from _walkers(rule, lanelet)
            yield from _roads_elsewhere(checked, rule, lanelet)
        for line_id in checked.ways_in(rule, "ref_line"):
            kind = checked.way_tags(line_id).get("type", "")
            if kind != "stop_line":
                yield _NOT_A_LINE.at(
                    line_id,
                    f"of type '{kind}' is the ref_line of regulatory element {rule.rule_id}",
                )
        yield from far_apart(checked, rule, _FAR_APART)


def _members(checked: CheckedMap, rule: RegulatoryElement) -> Iterator[MapIssue]:
    """Yield what is wrong with how many members a regulatory element has."""
    crosswalks = checked.lanelets_in(rule, "refers")
    if not crosswalks:
        yield _NO_CROSSWALK.at(rule.rule_id, "(crosswalk) refers to no lanelet")
    elif len(crosswalks) > 1:
        yield _TWO_CROSSWALKS.at(
            rule.rule_id, f"(crosswalk) refers to {len(crosswalks)} lanelets {listed(crosswalks)}"
        )
    lines = checked.ways_in(rule, "ref_line")
    if not lines:
        yield _NO_LINE.at(rule.rule_id, "(crosswalk) has no stop line")
    elif len(lines) > 1:
        yield _TWO_LINES.at(
            rule.rule_id, f"(crosswalk) has {len(lines)} stop lines {listed(lines)}"
        )


def _walkers(rule: RegulatoryElement, lanelet: Lanelet) -> Iterator[MapIssue]:
    """Yield what is wrong with the tags of the lanelet that a regulatory element refers to."""
    of = f"is the crosswalk of regulatory element {rule.rule_id} and"
    if lanelet.subtype != "crosswalk":
        yield _NOT_A_CROSSWALK.at(lanelet.lanelet_id, f"{of} has subtype '{lanelet.subtype}'")
    word = lanelet.tags.get("participant:pedestrian")
    if word is None:
        yield _NOBODY_WALKS.at(lanelet.lanelet_id, f"{of} has no participant:pedestrian")
    elif word not in ("yes", "true"):
        yield _NOBODY_MAY_WALK.at(lanelet.lanelet_id, f"{of} has participant:pedestrian='{word}'")


def _roads_elsewhere(
    checked: CheckedMap, rule: RegulatoryElement, crosswalk: Lanelet
) -> Iterator[MapIssue]:
    ground = checked.lanelet_ground(crosswalk.lanelet_id)
    for road_id in checked.lanelets_under(rule.rule_id):
        is_road = checked.hd_map.lanelets[road_id].subtype == "road"
        if is_road and not ground.intersects(checked.lanelet_ground(road_id)):
            yield _ELSEWHERE.at(
                rule.rule_id,
                f"holds for road {road_id}, which crosswalk {crosswalk.lanelet_id} does not cross",
            )


CROSSWALK_SAFETY_ATTRIBUTES = Rule(
    name=_SAFETY,
    looks_for="Speeds and distances to slow down at crosswalks that are no number over 0",
    codes=(_NO_SPEED, _NO_DISTANCE),
    find=_safety_attributes,
)
CROSSWALK_MISSING_REGULATORY_ELEMENTS = Rule(
    name=_MISSING,
    looks_for="Crosswalks that no regulatory element of a crosswalk refers to",
    codes=(_NO_RULE,),
    requirements=("vm-05-01",),
    find=_missing_regulatory_elements,
)
CROSSWALK_DETAILS = Rule(
    name=_DETAILS,
    looks_for="Regulatory elements of crosswalks with members that are missing, wrong or far off",
    codes=(
        _NO_CROSSWALK, _TWO_CROSSWALKS, _NO_LINE, _NOT_A_CROSSWALK, _NOT_A_LINE, _TWO_LINES,
        _NOBODY_WALKS, _NOBODY_MAY_WALK, _ELSEWHERE, _FAR_APART,
    ),
    requirements=("vm-05-01",),
    find=_regulatory_element_details,
)  # fmt: skip
