"""`percept view`: a run in rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percept.core.errors import InputError

__all__ = ["view"]


def view(run: Annotated[Path, typer.Argument(help="Run folder, or an .rrd file.")]) -> None:
    """Open a run in the rerun viewer that comes with percept.

    Example: percept demo --out demo && percept view demo/run
    """
    recording = run / "view.rrd" if run.is_dir() else run
    if not recording.is_file():
        raise InputError("has no view.rrd", where=run, remedy="Give the --out folder of a run")
    from percept.export.viewer import open_view

    open_view(recording)
