"""`percept track`: what happens over time, again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from percept.cli.options import ConfigOption, ForceOption, JsonOption, OutOption

__all__ = ["MapOption", "OriginOption", "track"]

MapOption = Annotated[
    Path | None,
    typer.Option("--map", help="Lanelet2 map (.osm): traffic lights are those of the map."),
]
OriginOption = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON[,ALT]",
        help="Where the frame of the map lies on the earth, where the map does not say.",
    ),
]


def track(
    run: Annotated[
        Path, typer.Argument(help="Run folder of `percept detect`.", show_default=False)
    ],
    *,
    out: OutOption,
    map_file: MapOption = None,
    origin: OriginOption = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            "--poses",
            help="Where the vehicle was, in place of what the run knows: poses.parquet of "
            "`percept odometry`.",
        ),
    ] = None,
    config: ConfigOption = None,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write overlay.mcap for Foxglove and rviz too.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Track the objects and traffic lights of a finished run again, with other settings.

    Nothing is detected again, and the log is not needed: boxes, images, poses and sensors come
    from the tables of the run. Writes tracks.parquet, lights.parquet, view.rrd, report.html and
    run.json into --out.

    Example: percept demo --out demo && percept track demo/run --map demo/map.osm --out again
    """
    from percept.cli.track.request import TrackRequest
    from percept.cli.track.run import run_tracking
    from percept.cli.track.show import show_tracks

    done = run_tracking(
        TrackRequest(
            run=run,
            out=out,
            map_file=map_file,
            origin=origin,
            poses=poses,
            config=config,
            overlay=mcap,
            force=force,
        )
    )
    if as_json:
        typer.echo(json.dumps(done, indent=2))
    else:
        show_tracks(done, out)
    raise typer.Exit(done["exit_code"])
