"""`percept map review`: a local page on which a person decides each finding."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from percept.core.errors import UsageError

__all__ = ["review"]


def review(
    run: Annotated[Path, typer.Argument(help="Run folder of `percept map validate`.")],
    *,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this computer; 0 takes a free one.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Do not open the page in a browser.")
    ] = False,
    export: Annotated[
        Path | None,
        typer.Option("--export", metavar="DIR", help="Show no page; write what was decided here."),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option(
            "--map", help="With --export: the map, where it is not where the run read it from."
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="With --export: write over files that are there.")
    ] = False,
) -> None:
    """Decide on a local page which findings are right.

    The page is for this computer alone, and asks no other. Keys: j and k next and previous, c
    confirm, r reject, u unsure, m comment, ? all of them. A decision is kept as soon as the page
    says that it is saved, in `review.sqlite` in the run folder.

    Example: percept demo --out demo && percept map validate --bag demo/drive.mcap --map
    demo/map.osm --out checked && percept map review checked --export decided
    """
    if export is not None:
        from percept.cli.map.review_export import export_review

        export_review(run, export, map_file, force=force)
        return
    if map_file is not None or force:
        raise UsageError("--map and --force belong to --export")
    from percept.review.server import DECISIONS, serve

    def ready(address: str) -> None:
        typer.echo(address)  # typer flushes: who waits for the address gets it at once
        typer.echo(f"decisions: {run / DECISIONS}; Ctrl-C ends", err=True)
        if not no_browser:
            _open(address)

    serve(run, port=port, on_ready=ready)


def _open(address: str) -> None:
    """Open the page, if there is a screen to open it on."""
    import os
    import sys

    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        typer.echo("there is no screen here: open the address in a browser", err=True)
        return
    import webbrowser

    if not webbrowser.open(address):
        typer.echo("no browser was found: open the address in one", err=True)
