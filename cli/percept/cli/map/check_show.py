"""What `percept map check` prints."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import typer

from percept.hdmap import HdMap
from percept.hdmap.check import NOT_IMPLEMENTED, RULES, MapIssue

__all__ = ["issues_document", "rules_document", "show_issues", "show_rules"]

_SEVERITIES = ("Error", "Warning", "Info")
_SHOWN_OF_A_KIND = 10


def issues_document(issues: Sequence[MapIssue]) -> dict[str, Any]:
    """Return issues as `--json` prints them."""
    fields = ("issue_code", "rule", "severity", "primitive", "primitive_id", "message")
    return {"issues": [{name: getattr(issue, name) for name in fields} for issue in issues]}


def rules_document() -> dict[str, Any]:
    """Return the rules as `--list-rules --json` prints them."""
    return {
        "rules": [
            {
                "name": rule.name,
                "looks_for": rule.looks_for,
                "requirements": list(rule.requirements),
                "severity": min((code.severity for code in rule.codes), key=_SEVERITIES.index),
                "codes": [code.code for code in rule.codes],
                "issues": [
                    {
                        "issue_code": code.code,
                        "severity": code.severity,
                        "primitive": code.primitive,
                        "remedy": code.remedy,
                    }
                    for code in rule.codes
                ],
            }
            for rule in RULES
        ],
        "not_implemented": [
            {"name": rule.name, "codes": list(rule.codes), "reason": rule.reason}
            for rule in NOT_IMPLEMENTED
        ],
    }


def show_issues(hd_map: HdMap, names: Sequence[str], issues: Sequence[MapIssue]) -> None:
    """Print issues by rule and kind: how many, where, and what to do.

    Args:
        hd_map: The map.
        names: The rules that it was held to.
        issues: What breaks them.
    """
    by_rule: defaultdict[str, defaultdict[str, list[MapIssue]]]
    by_rule = defaultdict(lambda: defaultdict(list))
    for issue in issues:
        by_rule[issue.rule][issue.issue_code].append(issue)
    for name, by_code in by_rule.items():
        typer.echo(f"{name}: {sum(map(len, by_code.values()))}")
        for code, alike in sorted(by_code.items()):
            _show_kind(code, alike)
        typer.echo("")
    typer.echo(
        f"held {len(hd_map.lanelets)} lanelets, {len(hd_map.line_strings)} line strings and "
        f"{len(hd_map.rules)} regulatory elements to {len(names)} rules: {_counted(issues)}"
    )
    for reason, count in hd_map.dropped.items():
        typer.echo(f"note: {count} {reason}")


def _show_kind(code: str, alike: Sequence[MapIssue]) -> None:
    typer.echo(f"  {code}  {alike[0].severity}  {len(alike)}")
    for issue in alike[:_SHOWN_OF_A_KIND]:
        typer.echo(f"    {issue.primitive} {issue.primitive_id} {issue.what}")
    if len(alike) > _SHOWN_OF_A_KIND:
        typer.echo(f"    and {len(alike) - _SHOWN_OF_A_KIND} more; --json lists all")
    typer.echo(f"    what to do: {alike[0].remedy}")


def _counted(issues: Sequence[MapIssue]) -> str:
    counts = Counter[str](issue.severity for issue in issues)
    parts = [f"{counts[severity]} {severity}" for severity in _SEVERITIES if counts[severity]]
    return f"{len(issues)} issues ({', '.join(parts)})" if parts else "no issue"


def show_rules() -> None:
    """Print the rules with their numbers, and what is not checked."""
    for rule in RULES:
        needs = f" ({', '.join(rule.requirements)})" if rule.requirements else ""
        typer.echo(f"{rule.name}{needs}")
        typer.echo(f"  {rule.looks_for}.")
        for code in rule.codes:
            typer.echo(f"  {code.code}  {code.severity}  {code.primitive}: {code.remedy}.")
    for missing in NOT_IMPLEMENTED:
        typer.echo(f"not checked: {missing.name} ({', '.join(missing.codes)}): {missing.reason}")
