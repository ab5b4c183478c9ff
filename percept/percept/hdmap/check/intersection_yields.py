"""Whom a lanelet of an intersection yields to, by what its regulatory element says.

A regulatory element of subtype `right_of_way` names one lanelet by the role `right_of_way`, and by
the role `yield` the lanelets that are looked at before that is entered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_conflict import Conflict, conflicts_of
from percept.hdmap.check.issue import IssueCode, MapIssue, Primitive, Severity
from percept.hdmap.elements import RegulatoryElement

__all__ = ["RIGHT_OF_WAY", "OwnerCodes", "YieldCodes", "about_owner", "about_yields", "is_owner"]

RIGHT_OF_WAY = "right_of_way"
"""Subtype of the regulatory elements, and role of the lanelet that each is for."""

_REGULATION: Primitive = "regulatory element"
_OWN = "Give each lanelet its own regulatory element, with it alone as right_of_way"


@dataclass(frozen=True, slots=True)
class YieldCodes:
    """What can be wrong with the yields of a regulatory element.

    Attributes:
        missing: It lacks a lanelet that crosses.
        needless: It has one that does not.
        slight: It lacks one that covers so little that it may not cross.
    """

    missing: IssueCode
    needless: IssueCode
    slight: IssueCode

    @classmethod
    def numbered(
        cls, rule: str, prefix: str, numbers: tuple[int, int, int], needless: Severity
    ) -> YieldCodes:
        """Return the codes of a rule by their numbers in the order of the attributes."""
        missing, surplus, slight = (f"{prefix}-{number:03d}" for number in numbers)
        look = "See whether one has to yield there, and add it as yield if so"
        return cls(
            IssueCode(missing, rule, "Error", _REGULATION, "Add that lanelet as yield"),
            IssueCode(surplus, rule, needless, _REGULATION, "Remove that lanelet as yield"),
            IssueCode(slight, rule, "Info", _REGULATION, look),
        )


@dataclass(frozen=True, slots=True)
class OwnerCodes:
    """What can be wrong with the lanelet that a regulatory element is for.

    Attributes:
        count: It is not one.
        other: It is another than the one that refers to the element.
    """

    count: IssueCode
    other: IssueCode

    @classmethod
    def numbered(cls, rule: str, prefix: str, numbers: tuple[int, int]) -> OwnerCodes:
        """Return the codes of a rule by their numbers in the order of the attributes."""
        count, other = (f"{prefix}-{number:03d}" for number in numbers)
        return cls(
            IssueCode(count, rule, "Info", _REGULATION, _OWN),
            IssueCode(other, rule, "Error", _REGULATION, _OWN),
        )


def is_owner(checked: CheckedMap, rule: RegulatoryElement, lanelet_id: int) -> bool:
    """Return whether a regulatory element is for a lanelet."""
    return lanelet_id in checked.lanelets_in(rule, RIGHT_OF_WAY)


def about_owner(
    checked: CheckedMap, rule: RegulatoryElement, lanelet_id: int, codes: OwnerCodes
) -> Iterator[MapIssue]:
    """Yield what keeps a regulatory element from being for the lanelet that refers to it alone."""
    owners = rule.ids(RIGHT_OF_WAY, "relation")
    if len(owners) != 1:
        what = f"has {len(owners)} lanelets as right_of_way, not one"
        yield codes.count.at(rule.rule_id, what)
    elif not is_owner(checked, rule, lanelet_id):
        yield codes.other.at(rule.rule_id, f"is for lanelet {owners[0]}, but {lanelet_id} names it")


def about_yields(
    checked: CheckedMap,
    rule: RegulatoryElement,
    lanelet_id: int,
    yields_to: Callable[[Conflict], bool],
    codes: YieldCodes,
) -> Iterator[MapIssue]:
    """Yield where the yields of a regulatory element differ from what its lanelet has to yield to.

    What covers the lanelet only slightly may be a yield or not.

    Args:
        checked: The map.
        rule: The regulatory element.
        lanelet_id: The lanelet that it is for.
        yields_to: Whether that lanelet has to yield to one that is on its way.
        codes: What to report it as.
    """
    has = set(checked.lanelets_in(rule, "yield"))
    needs = {c.lanelet_id: c for c in conflicts_of(checked, lanelet_id) if yields_to(c)}
    for other in sorted(needs.keys() - has):
        what = f"lets lanelet {lanelet_id} not yield to lanelet {other}"
        if needs[other].slight:
            share = f"{100 * needs[other].share:.2g} %"
            yield codes.slight.at(rule.rule_id, f"{what}, which covers {share} of it")
        else:
            yield codes.missing.at(rule.rule_id, f"{what}, which crosses it")
    for other in sorted(has - needs.keys()):
        what = f"lets lanelet {lanelet_id} yield to lanelet {other}, which it need not"
        yield codes.needless.at(rule.rule_id, what)
