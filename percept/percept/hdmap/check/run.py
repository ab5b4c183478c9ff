"""Holding a map to rules."""

from __future__ import annotations

from collections.abc import Collection

from percept.core.errors import UsageError
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.rule_table import RULES
from percept.hdmap.map import HdMap

__all__ = ["check_map", "rules_named"]


def check_map(hd_map: HdMap, rules: Collection[str] | None = None) -> tuple[MapIssue, ...]:
    """Return all that breaks the rules, in the order of the rules, then of the primitives.

    Args:
        hd_map: The map.
        rules: Names of the rules to hold it to; None for all.

    Raises:
        UsageError: If there is no rule of a name.
    """
    checked = CheckedMap(hd_map)
    return tuple(
        issue
        for rule in rules_named(rules)
        for issue in sorted(rule.find(checked), key=lambda issue: issue.primitive_id)
    )


def rules_named(names: Collection[str] | None) -> tuple[Rule, ...]:
    """Return the rules of names, in the order of the table; all of them for None.

    Raises:
        UsageError: If there is no rule of a name.
    """
    if names is None:
        return RULES
    known = {rule.name for rule in RULES}
    unknown = sorted(set(names) - known)
    if unknown:
        raise UsageError(
            f"no rule has the name {unknown[0]!r}",
            where="--rule",
            remedy="List the rules with 'percept map check --list-rules'",
        )
    return tuple(rule for rule in RULES if rule.name in names)
