"""A rule that a map can break by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue

__all__ = ["Rule", "RuleNotImplemented"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A rule, and the function that finds what breaks it.

    Attributes:
        name: Such as `mapping.lane.border_sharing`.
        looks_for: What breaks it, as a sentence without its full stop.
        codes: The numbered kinds of what it finds.
        requirements: Ids of the requirements for vector maps that it holds a map to
            (Autoware's, such as `vm-01-03`); empty where there is none.
        find: Yields what breaks it; each issue is made by one of the codes.
    """

    name: str
    looks_for: str
    codes: tuple[IssueCode, ...]
    requirements: tuple[str, ...] = ()
    find: Callable[[CheckedMap], Iterator[MapIssue]]


@dataclass(frozen=True, slots=True)
class RuleNotImplemented:
    """A rule, or a numbered part of one, that is not checked.

    Attributes:
        name: The rule's name.
        codes: The numbers that are never reported.
        reason: Why it is not checked.
    """

    name: str
    codes: tuple[str, ...]
    reason: str
