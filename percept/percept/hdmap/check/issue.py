"""What a rule finds in a map, and the numbered kinds of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

__all__ = ["IssueCode", "MapIssue", "Primitive", "Severity", "listed"]

Primitive: TypeAlias = Literal["lanelet", "linestring", "point", "polygon", "regulatory element"]
Severity: TypeAlias = Literal["Error", "Warning", "Info"]

_LISTED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class MapIssue:
    """A place at which a map breaks a rule.

    Attributes:
        issue_code: Its number, such as `Lane.BorderSharing-001`.
        rule: The rule's name, such as `mapping.lane.border_sharing`.
        severity: How bad that is for software that drives by the map.
        primitive: What of the map breaks it.
        primitive_id: The id of that.
        what: What is wrong with it, with the ids of all that are involved: a clause whose
            subject is the primitive.
        remedy: What to do about it: a sentence without its full stop.
    """

    issue_code: str
    rule: str
    severity: Severity
    primitive: Primitive
    primitive_id: int
    what: str
    remedy: str

    @property
    def message(self) -> str:
        """What is wrong where, and what to do about it."""
        return f"{self.primitive} {self.primitive_id} {self.what}. {self.remedy}."


@dataclass(frozen=True, slots=True)
class IssueCode:
    """One way in which a map can break a rule.

    Attributes:
        code: Its number, such as `Lane.BorderSharing-001`.
        rule: The rule's name.
        severity: How bad that is.
        primitive: What of the map it is reported for.
        remedy: What to do about it: a sentence without its full stop.
    """

    code: str
    rule: str
    severity: Severity
    primitive: Primitive
    remedy: str

    def at(self, primitive_id: int, what: str) -> MapIssue:
        """Return the issue at a primitive.

        Args:
            primitive_id: The primitive that breaks the rule.
            what: What is wrong with it, as a clause without its full stop whose subject is the
                primitive (`has no ...`); the message adds the primitive before and the remedy
                after it.
        """
        return MapIssue(
            issue_code=self.code,
            rule=self.rule,
            severity=self.severity,
            primitive=self.primitive,
            primitive_id=primitive_id,
            what=" ".join(what.split()),  # words of the map may hold line breaks
            remedy=self.remedy,
        )


def listed(ids: Sequence[int]) -> str:
    """Return ids for a message; of many the first ones and how many more there are."""
    shown = ", ".join(str(identity) for identity in ids[:_LISTED])
    return shown if len(ids) <= _LISTED else f"{shown} and {len(ids) - _LISTED} more"
