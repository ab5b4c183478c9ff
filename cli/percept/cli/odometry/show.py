"""What `percept odometry` says on the screen about a finished run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

__all__ = ["show_odometry"]


def show_odometry(run: Mapping[str, Any], out: Path) -> None:
    """Print a run in a few lines; what was left out goes to stderr.

    Args:
        run: The content of its `run.json`.
        out: The run folder.
    """
    counts = run["counts"]
    for note in run.get("notes", ()):
        typer.echo(f"note: {note}", err=True)
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    typer.echo(
        f"{counts['poses']} poses of {counts['child_frame_id']} in {counts['frame_id']} "
        f"by {counts['source']}: {counts['way_m']:.1f} m in {counts['seconds']:.1f} s, "
        f"{counts['gaps']} gaps, {counts['jumps']} jumps"
    )
    if counts["sd_position_end_m"] is not None:
        typer.echo(f"standard deviation of the last position: {counts['sd_position_end_m']:.2f} m")
    for drift in counts["drift"]:
        percent = drift["translation_percent"]
        over = "" if percent is None else f"{percent:.2f} % of the way, "
        typer.echo(
            f"drift from {drift['against']}: {over}{drift['ate_m']:.3f} m absolute, "
            f"{drift['end_m']:.2f} m at the end of {drift['way_m']:.1f} m"
        )
    typer.echo(f"verdict: {': '.join([run['verdict'], *filter(None, ['; '.join(run['why'])])])}")
    typer.echo(f"look at it: {out / 'report.html'}")
