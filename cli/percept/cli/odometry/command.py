"""`percept odometry`: where the vehicle was, from what a log has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from percept.cli.options import (
    BagOption,
    ConfigOption,
    EndOption,
    ForceOption,
    JsonOption,
    OutOption,
    StartOption,
)

__all__ = ["odometry"]


def odometry(
    *,
    bag: BagOption,
    out: OutOption,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", help="Rig file: where the LiDARs sit; wins over the log's own."),
    ] = None,
    source: Annotated[
        Literal["auto", "gnss", "odometry", "pose", "tf", "lidar"],
        typer.Option(
            "--source",
            help="What the poses are made from. auto: the best that the log has, and its LiDAR "
            "where it has nothing.",
        ),
    ] = "auto",
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            help="Use this topic: fixes, an IMU, odometry, poses, transforms or a LiDAR. Repeat it "
            "for several.",
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            "--reference",
            metavar="FILE",
            help="Where the vehicle really was: a TUM file or a poses.parquet. The drift from it "
            "is told.",
        ),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find out where the vehicle was, and how well that is known.

    Writes poses.parquet, quality.parquet, trajectory.tum, trajectory.kitti, report.html and
    run.json into --out. A pose from LiDAR is that of the end of its scan.

    Example: percept synth drive --seconds 2 --cameras none --out block &&
    percept odometry --bag block/drive.mcap --source lidar
    --reference block/truth/poses.parquet --out way
    """
    from percept.cli.odometry.request import OdometryRequest
    from percept.cli.odometry.run import run_odometry
    from percept.cli.odometry.show import show_odometry

    request = OdometryRequest(
        bags=tuple(bag),
        rig=rig,
        source=source,
        topics=tuple(topic or ()),
        reference=reference,
        config=config,
        start_s=start,
        end_s=end,
        out=out,
        force=force,
    )
    run = run_odometry(request)
    if as_json:
        typer.echo(json.dumps(run, indent=2, allow_nan=False))
    else:
        show_odometry(run, out)
    raise typer.Exit(run["exit_code"])
