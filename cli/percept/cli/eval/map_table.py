"""What `percept eval map` prints for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from percept.cli.columns import columns
from percept.evaluation.map_findings import KindCounts, MapScores, PlacedFinding

__all__ = ["show_map_scores"]

_HEADER = ("planted", "found", "missed", "false", "precision", "recall", "F1", "offset error")
_MOST_LISTED = 10


def show_map_scores(scores: MapScores, out: Path | None) -> None:
    """Print the scores by kind and together, what is missed or false, and the verdict.

    Args:
        scores: The scores.
        out: The run folder, where there is one.
    """
    rows: list[tuple[str, ...]] = [("kind", *_HEADER)]
    rows += [(str(kind), *_cells(one)) for kind, one in scores.by_kind.items()]
    rows.append(("all", *_cells(scores.total)))
    typer.echo("\n".join(columns(rows)))
    if scores.false_per_km is not None:
        typer.echo(
            f"driven: {scores.driven_km:.2f} km, {scores.false_per_km:.2f} false findings a km"
        )
    _list("missed", scores.missed)
    _list("false", scores.false)
    for reason, count in scores.dropped.items():
        typer.echo(f"left out: {count} {reason}")
    typer.echo(f"verdict: {scores.verdict}")
    for reason in scores.why:
        typer.echo(f"  - {reason}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _cells(counts: KindCounts) -> tuple[str, ...]:
    figures = counts.document()
    error = figures["offset_error_m"]
    return (
        *(str(figures[name]) for name in ("planted", "found", "missed", "false")),
        *(
            "-" if figures[n] is None else f"{figures[n]:.3f}"
            for n in ("precision", "recall", "f1")
        ),
        "-" if error is None else f"{error:.3f} m",
    )


def _list(word: str, findings: Sequence[PlacedFinding]) -> None:
    for finding in findings[:_MOST_LISTED]:
        x, y = finding.middle_m
        element = f", element {finding.map_element_id}" if finding.map_element_id else ""
        typer.echo(f"{word}: {finding.kind} at {x:.1f}, {y:.1f}{element}")
    if len(findings) > _MOST_LISTED:
        typer.echo(f"{word}: {len(findings) - _MOST_LISTED} more, see --json")
