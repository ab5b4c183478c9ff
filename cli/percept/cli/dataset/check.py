"""`percept dataset check`: what is wrong with a data set."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption

__all__ = ["check"]


def check(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="A folder of `percept dataset prepare`, or one in a format of labelling tools.",
            show_default=False,
        ),
    ],
    *,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Write report.html and check.json here; new or empty."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say what is wrong with a data set: files, images, boxes, ids, classes, and leaks of splits.

    Checks tables and all formats of a prepared data set, and folders of others in COCO, YOLO,
    KITTI, CVAT, Label Studio, nuScenes, OpenLABEL or SUSTechPOINTS. Nothing is changed. Ends with 4
    when there is an error.

    Example: percept demo --out demo && percept dataset prepare --run demo/run --format coco
    --out set && percept dataset check set
    """
    from percept.cli.dataset.check_run import check_document, run_check
    from percept.cli.dataset.check_table import show_check

    result = run_check(folder, out, force=force)
    if as_json:
        typer.echo(json.dumps(check_document(result), indent=2, allow_nan=False))
    else:
        show_check(result, out)
    raise typer.Exit(result.verdict.exit_code)
