"""`percept eval map`: findings about a map against the changes that were planted into it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption

__all__ = ["map_findings"]


def map_findings(
    *,
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="A run folder of `percept map validate`, or its discrepancies.parquet.",
            show_default=False,
        ),
    ],
    truth: Annotated[
        Path,
        typer.Option(
            "--truth",
            help="What was planted: the folder of a synthetic drive, or its map_changes.json.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Run folder with scores.json and report.html; new or empty."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Score findings about a map: precision, recall and F1 by kind, false findings a km.

    A finding meets a planted change of its kind by the element of the map, or by its place where
    the map has no such element; one to one. Ends with 4 when there is nothing to score.

    Example: percept demo --out demo && percept map validate --bag demo/drive.mcap --map
    demo/map.osm --out checked && percept eval map checked --truth demo
    """
    from percept.cli.eval.map_run import MapEvalRequest, run_map_eval
    from percept.cli.eval.map_table import show_map_scores

    scores, document = run_map_eval(MapEvalRequest(run=run, truth=truth, out=out, force=force))
    if as_json:
        typer.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        show_map_scores(scores, out)
    raise typer.Exit(scores.verdict.exit_code)
