"""What `percept dataset prepare` says on a terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

__all__ = ["show_preparation"]


def show_preparation(document: dict[str, Any], out: Path) -> None:
    """Print a summary of `run.json`.

    Args:
        document: Its content.
        out: The folder.
    """
    counts = document["counts"]
    parts = ", ".join(f"{count} {name}" for name, count in counts["images_by_split"].items())
    typer.echo(
        f"{counts['images']} of {counts['images_in_logs']} images, at {counts['keyframes']} "
        f"moments of {counts['drives']} drives: {parts}"
    )
    typer.echo(
        f"{counts['boxes_2d']} boxes in images, {counts['boxes_3d']} in space, "
        f"{counts['classes']} classes, {counts['scans']} scans"
    )
    for kind, count in counts.get("blurred", {}).items():
        typer.echo(f"made unreadable: {count} {kind}")
    for reason, count in document["dropped"].items():
        typer.echo(f"left out: {count} x {reason}")
    for note in document.get("notes", []):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"verdict: {document['verdict']}: {'; '.join(document['why'])}")
    typer.echo(f"look at it: {out / 'report.html'}; what is where: {out / 'README.md'}")
