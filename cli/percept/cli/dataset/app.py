"""The commands of `percept dataset`."""

from __future__ import annotations

import typer

from percept.cli.dataset.check import check
from percept.cli.dataset.diff import diff
from percept.cli.dataset.import_labels import import_labels
from percept.cli.dataset.prepare import prepare

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.command("prepare")(prepare)
app.command("check")(check)
app.command("import")(import_labels)
app.command("diff")(diff)


@app.callback()
def dataset() -> None:
    """Data sets for labelling: prepared from logs, checked, corrected labels back in, compared.

    Example: percept dataset --help
    """
