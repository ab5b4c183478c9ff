"""Rules that a map can break by itself: no log is needed to find that it does.

`check_map` holds a map to the rules of `rule_table`. A rule is a function of a `CheckedMap`, by
which all of them look things up, and yields issues made by its `IssueCode` constants.
"""

from __future__ import annotations

from percept.hdmap.check.issue import MapIssue
from percept.hdmap.check.rule import Rule, RuleNotImplemented
from percept.hdmap.check.rule_table import NOT_IMPLEMENTED, RULES
from percept.hdmap.check.run import check_map, rules_named

__all__ = [
    "NOT_IMPLEMENTED",
    "RULES",
    "MapIssue",
    "Rule",
    "RuleNotImplemented",
    "check_map",
    "rules_named",
]
