"""What is said on the screen about tracks and lights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

__all__ = ["show_over_time", "show_tracks"]


def show_tracks(run: Mapping[str, Any], out: Path) -> None:
    """Print a run of `percept track` in a few lines; what was left out goes to stderr.

    Args:
        run: The content of its `run.json`.
        out: The run folder.
    """
    show_over_time(run["counts"])
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    for note in run.get("notes", ()):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"verdict: {run['verdict']}: {'; '.join(run['why'])}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def show_over_time(counts: Mapping[str, Any]) -> None:
    """Print how many tracks and lights there are; nothing where nothing was tracked."""
    if "tracks" in counts:
        listed = ", ".join(f"{count} {label}" for label, count in counts["tracks"].items())
        typer.echo(f"{sum(counts['tracks'].values())} tracks ({listed or 'none'})")
    if "lights" in counts:
        plural = "" if counts["lights"] == 1 else "s"
        typer.echo(f"{counts['lights']} traffic light{plural}")
