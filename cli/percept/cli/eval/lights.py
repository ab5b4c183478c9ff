"""`percept eval lights`: states of traffic lights against truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption

__all__ = ["lights"]


def lights(
    *,
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="A run folder with lights.parquet, made with the map of the drive.",
            show_default=False,
        ),
    ],
    labels: Annotated[
        Path,
        typer.Option(
            "--labels",
            help="What was there: the truth folder of a synthetic drive, or another with a "
            "lights.parquet.",
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
    """Score what traffic lights are said to show: right, unknown, red read as green, how late.

    Only moments count at which a camera sees the light. Lights meet by their ids in the map, so
    a run without one cannot be scored. Ends with 4 when no light is seen at any moment.

    Example: percept demo --out demo && percept eval lights demo/run --labels demo/truth
    """
    from percept.cli.eval.lights_run import LightEvalRequest, run_light_eval
    from percept.cli.eval.lights_table import show_light_scores

    scores, document = run_light_eval(
        LightEvalRequest(run=run, labels=labels, out=out, force=force)
    )
    if as_json:
        typer.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        show_light_scores(scores, out)
    raise typer.Exit(scores.verdict.exit_code)
