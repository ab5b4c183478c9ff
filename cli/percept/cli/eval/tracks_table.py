"""What `percept eval tracks` prints for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import typer

from percept.cli.eval.tracks_result import TrackEvalRun

__all__ = ["show_track_scores"]

_COLUMNS = {
    "num_objects": "objects",
    "samota": "sAMOTA",
    "mota": "MOTA",
    "motp": "MOTP",
    "hota": "HOTA",
    "idf1": "IDF1",
    "precision": "precision",
    "recall": "recall",
    "recall_any_label": "any label",
    "num_switches": "switches",
    "switches_over_gaps": "over gaps",
    "num_fragmentations": "fragments",
    "num_false_positives": "false",
    "num_misses": "missed",
    "velocity_rmse_mps": "speed rmse",
}


def show_track_scores(run: TrackEvalRun, out: Path | None) -> None:
    """Print the scores, what was left out, and the verdict with its reasons.

    Args:
        run: The scoring.
        out: The run folder, where there is one.
    """
    keys = [key for key in _COLUMNS if any(key in figures for figures in run.rows.values())]
    _print([("", *(_COLUMNS[key] for key in keys)), *_rows(run.rows, keys)])
    speed = run.document.get("speed")
    if speed is not None:
        typer.echo(f"tracker: {speed['frames_per_second']:,.0f} frames a second")
    for reason, count in run.dropped.items():
        typer.echo(f"left out: {count} {reason}")
    for note in run.notes:
        typer.echo(f"note: {note}")
    typer.echo(f"verdict: {run.verdict}")
    for reason in run.why:
        typer.echo(f"  - {reason}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _rows(
    rows: Mapping[str, Mapping[str, float | None]], keys: Sequence[str]
) -> list[tuple[str, ...]]:
    return [(name, *(_cell(figures.get(key)) for key in keys)) for name, figures in rows.items()]


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value}" if isinstance(value, int) else f"{value:.4f}"


def _print(rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        first = row[0].ljust(widths[0])
        rest = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        typer.echo("  ".join((first, *rest)).rstrip())
