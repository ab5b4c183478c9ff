"""What `percept dataset check` prints for people."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import typer

from percept.cli.columns import columns
from percept.datasets.labelling.check.dataset import CheckResult
from percept.datasets.labelling.check.problems import CODES

__all__ = ["show_check"]


def show_check(result: CheckResult, out: Path | None) -> None:
    """Print problems by kind with an example each, classes by split, and the verdict."""
    for code, number in result.found.items():
        kind = CODES[code]
        example = next(one for one in result.problems if one.code == code)
        typer.echo(f"{kind.severity}: {number:,} x {code}: {kind.means}")
        typer.echo(f"    {example.where}: {example.message}")
        typer.echo(f"    what to do: {kind.remedy}")
    if result.histogram:
        typer.echo("\n".join(_classes(result.histogram)))
    typer.echo(f"verdict: {result.verdict} ({_summary(result)})")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _classes(histogram: Mapping[str, Mapping[str, int]]) -> list[str]:
    splits = list(dict.fromkeys(split for row in histogram.values() for split in row))
    rows = [("boxes in images", *splits)]
    rows += [
        (label, *(f"{row.get(split, 0):,}" for split in splits)) for label, row in histogram.items()
    ]
    return list(columns(rows))


def _summary(result: CheckResult) -> str:
    counted = {"error": 0, "warning": 0, "info": 0}
    for code, number in result.found.items():
        counted[CODES[code].severity] += number
    found = ", ".join(f"{number:,} x {severity}" for severity, number in counted.items() if number)
    return f"{result.counts['images']:,} images, {found or 'nothing is wrong'}"
