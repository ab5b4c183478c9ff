"""`percept demo`: from nothing to detections that are scored against truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption

__all__ = ["demo"]


def demo(
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the drive and its run.")] = Path(
        "demo"
    ),
    seed: Annotated[int, typer.Option("--seed", min=0, help="Which world and drive.")] = 0,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.5, max=60, help="Length of the drive.")
    ] = 2.0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a small drive, look at its log, detect on it, and compare with the truth.

    Leaves the drive in --out and the run in its folder run/.

    Example: percept demo --out demo
    """
    from percept.cli.demo_run import run_demo

    result = run_demo(out, seed=seed, seconds=seconds, force=force, talk=not as_json)
    if as_json:
        typer.echo(json.dumps(result, indent=2))
