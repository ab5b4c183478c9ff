"""The commands of `percept map`."""

from __future__ import annotations

import typer

from percept.cli.map.check import check
from percept.cli.map.draw import draw
from percept.cli.map.info import info
from percept.cli.map.review import review
from percept.cli.map.validate import validate

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.command("info")(info)
app.command("draw")(draw)
app.command("check")(check)
app.command("validate")(validate)
app.command("review")(review)


@app.callback()
def hd_map() -> None:
    """HD maps (Lanelet2, OpenDRIVE): by themselves, against the road, and what people decide.

    Example: percept map --help
    """
