"""`percept map validate`: the markings that a drive sees against those of the map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from percept.cli.map.options import OriginOption
from percept.cli.options import (
    ConfigOption,
    EndOption,
    ForceOption,
    JsonOption,
    OutOption,
    StartOption,
    named_values,
)
from percept.core.errors import UsageError

__all__ = ["validate"]


def validate(
    *,
    bag: Annotated[
        list[Path],
        typer.Option(
            "--bag",
            help="The log of a drive: a ROS 1 .bag, a ROS 2 folder, a bare .db3 or .mcap. Repeat "
            "it for several drives: what all of them see is surer.",
            show_default=False,
        ),
    ],
    map_file: Annotated[
        Path,
        typer.Option(
            "--map",
            metavar="FILE",
            help="The HD map: Lanelet2 .osm or OpenDRIVE .xodr.",
            show_default=False,
        ),
    ],
    out: OutOption,
    origin: OriginOption = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig", help="Rig file: lenses and places of the sensors; wins over the log's own."
        ),
    ] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            "--camera",
            metavar="NAME=TOPIC",
            help="Look with this camera alone. Repeat it for several.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            "--tolerance",
            metavar="METRES",
            help="A line is moved from here on, if its spread allows. Default: 0.3.",
            show_default=False,
        ),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            "--spacing",
            metavar="METRES",
            help="The vehicle moves so far between two looks. Default: 1.",
            show_default=False,
        ),
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            metavar="NAME=FILE.onnx",
            help="The network that finds traffic lights. Without one the built-in network has to "
            "show first that it knows those of the map.",
        ),
    ] = None,
    lane_model: Annotated[
        Path | None,
        typer.Option(
            "--lane-model",
            metavar="FILE.onnx",
            help="A network that marks the paint of road lines: in place of contrast.",
            show_default=False,
        ),
    ] = None,
    no_lights: Annotated[
        bool, typer.Option("--no-lights", help="Leave traffic lights alone.")
    ] = False,
    poses: Annotated[
        Literal["auto", "gnss", "pose", "tf"],
        typer.Option("--poses", help="What tells where the vehicle was in the map."),
    ] = "auto",
    review: Annotated[
        list[Path] | None,
        typer.Option(
            "--review",
            metavar="FILE",
            help="Decisions of an earlier run (its review.sqlite): what was rejected does not "
            "come back.",
        ),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find where the HD map and the road disagree, from what cameras saw of the markings.

    Lines, their types and colours, stop lines and traffic lights are compared. Writes
    discrepancies.parquet and .geojson, coverage.parquet, evidence/, report.html, view.rrd and
    run.json into --out. What was not seen is never called missing. Decide the findings with
    `percept map review`.

    Example: percept demo --out demo && percept map validate --bag demo/drive.mcap --map
    demo/map.osm --out checked
    """
    from percept.cli.detect.flags import model_flags, model_requests
    from percept.cli.map.validate_request import MapValidateRequest
    from percept.cli.map.validate_run import run_map_validation
    from percept.cli.map.validate_show import show_map_validation

    if len({path.resolve() for path in bag}) < len(bag):
        raise UsageError("--bag names a log twice", remedy="Give each drive once")
    if no_lights and model:
        raise UsageError("--no-lights makes no use of --model", remedy="Leave one of them out")
    models = model_requests([] if no_lights else model or ["lights=builtin"], [])
    request = MapValidateRequest(
        bags=tuple(bag),
        map_file=map_file,
        out=out,
        origin=origin,
        rig=rig,
        cameras=named_values(camera or [], "--camera"),
        models=models,
        models_are_default=not model,
        lane_model=lane_model,
        poses=poses,
        reviews=tuple(review or ()),
        config=config,
        flags={
            "spacing_m": spacing,
            "validation": {"tolerance_m": tolerance},
            "models": model_flags([wanted.name for wanted in models]),
        },
        start_s=start,
        end_s=end,
        force=force,
    )
    run = run_map_validation(request)
    if as_json:
        typer.echo(json.dumps(run, indent=2, allow_nan=False))
    else:
        show_map_validation(run, out)
    raise typer.Exit(run["exit_code"])
