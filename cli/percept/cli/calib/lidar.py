"""`percept calib lidar`: where the LiDARs of a vehicle sit, seen from one of them."""

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
    OutOption,
    StartOption,
    named_values,
)

__all__ = ["lidar"]


def lidar(
    *,
    out: OutOption,
    cloud: Annotated[
        list[str] | None,
        typer.Option(
            "--cloud",
            metavar="NAME=PATH",
            help="A cloud of a LiDAR: pcd, ply, KITTI bin or npy. Repeat it for every LiDAR, and "
            "a name for every scene, in the same order of scenes.",
        ),
    ] = None,
    bag: Annotated[
        list[Path] | None,
        typer.Option(
            "--bag",
            metavar="LOG",
            help="A log with stops at several places, instead of --cloud: a ROS 1 .bag, a ROS 2 "
            "folder, a bare .db3 or .mcap. Repeat it for several logs of one drive.",
        ),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="NAME=TOPIC",
            help="A LiDAR of the log. Repeat it for several; without it all of them are used.",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference",
            metavar="NAME",
            help="LiDAR in whose frame the others are placed. Default: the first that is named, "
            "or the one with the most points.",
            show_default=False,
        ),
    ] = None,
    initial: Annotated[
        Path | None,
        typer.Option(
            "--initial",
            metavar="RIG",
            help="Rig file to begin with and to update. Its places are one more guess, no more.",
        ),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Place LiDARs in the frame of one of them, without a guess, and say how good that is.

    Writes calibration.json, report.html, view.rrd and run.json into --out, and rig.yaml where the
    result can be used. Record three places or more with walls, poles or vehicles in the view that
    the LiDARs share, standing still at each.

    Example: percept synth calib --stops 3 --cameras none --out stops &&
    percept calib lidar --bag stops/calib.mcap --topic top=/lidar_top/points
    --topic left=/lidar_left/points --out lidars
    """
    from percept.cli.calib.lidar_run import LidarRequest, run_lidar_calibration
    from percept.cli.calib.lidar_table import show_calibration

    request = LidarRequest(
        clouds=tuple(cloud or ()),
        bags=tuple(bag or ()),
        topics=named_values(topic or [], "--topic"),
        reference=reference,
        initial=initial,
        config=config,
        start_s=start,
        end_s=end,
        out=out,
        force=force,
    )
    run = run_lidar_calibration(request)
    if as_json:
        typer.echo(json.dumps(run.document, indent=2, allow_nan=False))
    else:
        show_calibration(run.result, run.notes, out)
    raise typer.Exit(run.result.verdict.exit_code)
