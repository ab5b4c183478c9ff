"""What `percept map validate` says on the screen about a finished run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

__all__ = ["show_map_validation"]

_REJECTED = "findings that a person rejected before"


def show_map_validation(run: Mapping[str, Any], out: Path) -> None:
    """Print a run in a few lines; what was left out goes to stderr.

    Args:
        run: The content of its `run.json`.
        out: The run folder.
    """
    counts = run["counts"]
    way_km = counts["way_m"] / 1000
    drives = "1 drive" if counts["drives"] == 1 else f"{counts['drives']} drives"
    not_seen_m = sum(counts["not_seen_m"].values())
    typer.echo(
        f"{drives}, {way_km:.2f} km: {counts['seen_m']:.0f} m of the map's lines seen, "
        f"{not_seen_m:.0f} m along the way not seen"
    )
    if not counts["findings"]:
        typer.echo("no finding: as far as it was seen, the road is as the map says")
    for kind, count in counts["kinds"].items():
        typer.echo(f"{count:4d} {kind.replace('_', ' ')}")
    if rejected := counts.get(_REJECTED):
        typer.echo(f"{rejected:4d} {_REJECTED}: not shown")
    for reason, metres in counts["not_seen_m"].items():
        typer.echo(f"not seen: {metres:.0f} m {reason}", err=True)
    for note in run.get("notes", ()):
        typer.echo(f"note: {note}", err=True)
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    typer.echo(f"verdict: {run['verdict']}: {'; '.join(run['why'])}")
    if counts["findings"]:
        typer.echo(f"decide them: percept map review {out}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")
