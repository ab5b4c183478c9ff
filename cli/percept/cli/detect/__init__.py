"""`percept detect`: objects in a log."""

from __future__ import annotations

import typer

from percept.cli.detect.command import detect
from percept.cli.detect.quantize import quantize

__all__ = ["app"]

app = typer.Typer(rich_markup_mode=None, subcommand_metavar="[COMMAND]")
app.callback(invoke_without_command=True)(detect)
app.command("quantize")(quantize)
