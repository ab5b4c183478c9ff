"""`percept eval tracks`: tracks against truth."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ConfigOption, ForceOption, JsonOption

__all__ = ["tracks"]


class _Format(StrEnum):
    AUTO = "auto"
    KITTI = "kitti"
    MOT = "mot"


def tracks(
    *,
    run: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN",
            help="A run folder with tracks, to score against the truth of a synthetic drive.",
            show_default=False,
        ),
    ] = None,
    detections: Annotated[
        list[Path] | None,
        typer.Option(
            "--detections",
            help="Folder of a detector's KITTI-format files, one a sequence: the tracker runs on "
            "them. Repeat it where each class has a folder of its own.",
            show_default=False,
        ),
    ] = None,
    tracks: Annotated[
        Path | None,
        typer.Option(
            "--tracks",
            help="Tracks of whatever tool: a MOTChallenge file, or a folder of KITTI tracking "
            "files with scores.",
            show_default=False,
        ),
    ] = None,
    labels: Annotated[
        Path,
        typer.Option(
            "--labels",
            help="What is there: KITTI's label_02, a MOTChallenge gt.txt, or the truth folder of "
            "a synthetic drive.",
            show_default=False,
        ),
    ],
    file_format: Annotated[
        _Format,
        typer.Option("--format", help="Format of the files; auto: a folder is kitti, a file mot."),
    ] = _Format.AUTO,
    online: Annotated[
        bool,
        typer.Option(
            "--online",
            help="Answer at each frame from what came before, as in a vehicle and as published "
            "trackers do; without it tracks know what came later, as those of percept detect.",
        ),
    ] = False,
    coast: Annotated[
        int | None,
        typer.Option(
            "--coast",
            min=0,
            metavar="FRAMES",
            help="With --online: report a track for so many frames after it was last seen. "
            "[default: 2]",
        ),
    ] = None,
    config: ConfigOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Run folder with tracks/, scores.json and report.html; new or empty."
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Score tracks: CLEAR-MOT, IDF1, HOTA; sAMOTA over 40 recalls on KITTI; velocities on a run.

    Give one of RUN, --detections and --tracks. With --detections the tracker runs first, with the
    settings of --config and with hindsight, unless --online is given, and its tracks are written to
    --out as KITTI tracking text. Ends with 4 when there is no object to track.

    Example: percept demo --out demo && percept eval tracks demo/run --labels demo/truth
    """
    from percept.cli.eval.tracks_result import TrackEvalRequest
    from percept.cli.eval.tracks_run import run_track_eval
    from percept.cli.eval.tracks_table import show_track_scores

    done = run_track_eval(
        TrackEvalRequest(
            run=run,
            detections=tuple(detections or ()),
            tracks=tracks,
            labels=labels,
            file_format=None if file_format is _Format.AUTO else file_format.value,
            online=online,
            coast=coast,
            config=config,
            out=out,
            force=force,
        )
    )
    if as_json:
        typer.echo(json.dumps(done.document, indent=2, allow_nan=False))
    else:
        show_track_scores(done, out)
    raise typer.Exit(done.verdict.exit_code)
