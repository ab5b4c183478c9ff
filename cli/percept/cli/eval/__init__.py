"""`percept eval`: results against truth."""

from __future__ import annotations

import typer

from percept.cli.eval.detections import detections
from percept.cli.eval.lanes import lanes
from percept.cli.eval.lights import lights
from percept.cli.eval.map import map_findings
from percept.cli.eval.tracks import tracks

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.command("detections")(detections)
app.command("lanes")(lanes)
app.command("lights")(lights)
app.command("map")(map_findings)
app.command("tracks")(tracks)


@app.callback()
def evaluate() -> None:
    """Score a run, or files of whatever tool, against labels.

    Example: percept eval --help
    """
