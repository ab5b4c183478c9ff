"""What `percept dataset diff` prints for people."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import typer

from percept.cli.columns import columns
from percept.cli.dataset.diff_run import DiffRun
from percept.datasets.labelling.corrections.diff_figures import ClassFigures

__all__ = ["show_diff"]

_HEADER = {
    "boxes_a": "in A", "boxes_b": "in B", "unchanged": "unchanged", "moved": "moved",
    "relabelled": "relabelled", "removed": "removed", "added": "added", "precision": "precision",
    "recall": "recall", "mean_iou_of_moved": "IoU of moved",
}  # fmt: skip


def show_diff(run: DiffRun, out: Path) -> None:
    """Print the figures by class, of 2D boxes and of 3D boxes that changed, and the verdict."""
    diff = run.diff
    typer.echo("\n".join(_table("2D", diff.by_class, diff.total)))
    if diff.has_solid_changes:
        typer.echo("\n".join(_table("3D", diff.solids_by_class, diff.solids_total)))
    for reason, number in diff.dropped.items():
        typer.echo(f"not compared: {number:,} {reason}")
    for note in diff.notes:
        typer.echo(f"note: {note}")
    typer.echo(f"verdict: {run.verdict}")
    for reason in run.why:
        typer.echo(f"  - {reason}")
    typer.echo(f"look at it: {out / 'report.html'}")


def _table(name: str, by_class: Mapping[str, ClassFigures], total: ClassFigures) -> list[str]:
    rows: list[tuple[str, ...]] = [(f"{name} boxes", *_HEADER.values())]
    for label, figures in {**by_class, "all classes": total}.items():
        values = figures.document()
        rows.append((label, *(_cell(values[key]) for key in _HEADER)))
    return list(columns(rows))


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"
