"""Rules on stop lines, and on the signs that ask to stop at them."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.extent import far_apart
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule

__all__ = ["STOP_LINE_MISSING_REGULATORY_ELEMENTS", "TRAFFIC_SIGN_DETAILS"]

_MISSING = "mapping.stop_line.missing_regulatory_elements"
_NO_RULE = IssueCode(
    "StopLine.MissingRegulatoryElements-001", _MISSING, "Error", "linestring",
    "Add it to the regulatory element that asks to stop here, or remove it",
)  # fmt: skip

_SIGN = "mapping.stop_line.regulatory_element_details_for_traffic_signs"
_NO_SIGN = IssueCode(
    "StopLine.RegulatoryElementDetailsForTrafficSigns-001", _SIGN, "Error", "regulatory element",
    "Add the line string of the sign with the role refers",
)  # fmt: skip
_NOT_A_SIGN = IssueCode(
    "StopLine.RegulatoryElementDetailsForTrafficSigns-002", _SIGN, "Error", "linestring",
    "Refer to a line string of type traffic_sign and subtype stop_sign",
)  # fmt: skip
_NO_LINE = IssueCode(
    "StopLine.RegulatoryElementDetailsForTrafficSigns-003", _SIGN, "Error", "regulatory element",
    "Add the stop line with the role ref_line",
)  # fmt: skip
_NOT_A_LINE = IssueCode(
    "StopLine.RegulatoryElementDetailsForTrafficSigns-004", _SIGN, "Error", "linestring",
    "Refer to a stop line, and set its subtype to stop_line",
)  # fmt: skip
_FAR_APART = IssueCode(
    "StopLine.RegulatoryElementDetailsForTrafficSigns-005", _SIGN, "Warning", "regulatory element",
    "Remove the members that do not belong to it",
)  # fmt: skip


def _missing_regulatory_elements(checked: CheckedMap) -> Iterator[MapIssue]:
    for line_id in checked.ways_of("stop_line"):
        if not checked.rules_about("way", line_id):
            yield _NO_RULE.at(line_id, "is a stop line that no regulatory element refers to")


def _traffic_sign_details(checked: CheckedMap) -> Iterator[MapIssue]:
    for rule in checked.rules_of("traffic_sign"):
        signs, lines = checked.ways_in(rule, "refers"), checked.ways_in(rule, "ref_line")
        if not signs:
            yield _NO_SIGN.at(rule.rule_id, "(traffic_sign) refers to no sign")
        if not lines:
            yield _NO_LINE.at(rule.rule_id, "(traffic_sign) has no ref_line")
        for sign_id in signs:
            tags = checked.way_tags(sign_id)
            kind, subtype = tags.get("type", ""), tags.get("subtype", "")
            if (kind, subtype) != ("traffic_sign", "stop_sign"):
                yield _NOT_A_SIGN.at(
                    sign_id,
                    f"of type '{kind}' and subtype '{subtype}' is the sign of regulatory element "
                    f"{rule.rule_id}",
                )
        for line_id in lines:
            subtype = checked.way_tags(line_id).get("subtype", "")
            if subtype != "stop_line":
                yield _NOT_A_LINE.at(
                    line_id,
                    f"of subtype '{subtype}' is the ref_line of regulatory element {rule.rule_id}",
                )
        yield from far_apart(checked, rule, _FAR_APART)


STOP_LINE_MISSING_REGULATORY_ELEMENTS = Rule(
    name=_MISSING,
    looks_for="Stop lines that no regulatory element refers to",
    codes=(_NO_RULE,),
    requirements=("vm-02-02",),
    find=_missing_regulatory_elements,
)
TRAFFIC_SIGN_DETAILS = Rule(
    name=_SIGN,
    looks_for="Regulatory elements of stop signs without a sign or a stop line, or with others",
    codes=(_NO_SIGN, _NOT_A_SIGN, _NO_LINE, _NOT_A_LINE, _FAR_APART),
    requirements=("vm-02-02",),
    find=_traffic_sign_details,
)
