"""`percept eval lanes`: lines and stop lines that were seen, against truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ForceOption, JsonOption

__all__ = ["lanes"]


def lanes(
    *,
    results: Annotated[
        Path,
        typer.Argument(
            metavar="RESULTS",
            help="A run folder of `percept lanes`, a JSON file of it, or lines of JSON with lanes "
            "and h_samples, as TuSimple has them.",
            show_default=False,
        ),
    ],
    truth: Annotated[
        Path,
        typer.Option(
            "--truth",
            help="What is there: the folder of a synthetic drive, a file of TuSimple label lines, "
            "or an instance mask (PNG) or a folder of them.",
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
    """Score lanes: in metres against a synthetic drive, in pixels against TuSimple's labels.

    In metres: the error of lines across the road and of stop lines along it by range, and the
    length of which type and colour are right. In pixels: accuracy, FP and FN by TuSimple's rules.
    Ends with 4 when there is nothing to score.

    Example: percept demo --out demo && percept lanes --bag demo/drive.mcap --rig demo/rig.yaml
    --camera cam_front --out seen && percept eval lanes seen --truth demo
    """
    from percept.cli.eval.lanes_run import LaneEvalRequest, run_lane_eval
    from percept.cli.eval.lanes_table import show_lane_scores

    scores, document = run_lane_eval(
        LaneEvalRequest(results=results, truth=truth, out=out, force=force)
    )
    if as_json:
        typer.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        show_lane_scores(scores, document, out)
    raise typer.Exit(scores.verdict.exit_code)
