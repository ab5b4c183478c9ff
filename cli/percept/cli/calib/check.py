"""`percept calib check`: does an old calibration still hold for this log?"""

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

__all__ = ["check"]


def check(
    *,
    rig: Annotated[Path, typer.Option("--rig", help="The rig file to check.", show_default=False)],
    out: OutOption,
    bag: Annotated[
        list[Path] | None,
        typer.Option(
            "--bag",
            help="The new log: a ROS 1 .bag, a ROS 2 folder, a bare .db3 or .mcap. Its LiDARs are "
            "checked against each other. Repeat it for several logs of one drive.",
        ),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="NAME=TOPIC",
            help="A LiDAR of the rig and its topic in the log. Default: the topics of the rig.",
        ),
    ] = None,
    cloud: Annotated[
        list[str] | None,
        typer.Option(
            "--cloud",
            metavar="NAME=PATH",
            help="A cloud of a LiDAR of the rig instead: pcd, ply, KITTI bin or npy. Repeat it "
            "for every LiDAR, and a name for every scene, in the same order of scenes.",
        ),
    ] = None,
    pair: Annotated[
        list[str] | None,
        typer.Option(
            "--pair",
            metavar="IMAGE=CLOUD",
            help="An image and the cloud of the same moment that show the board. Repeat it for "
            "every pose.",
        ),
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(
            "--pairs",
            metavar="CSV",
            help="A table of pairs instead, with the header image,cloud; paths count from it.",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference",
            metavar="NAME",
            help="LiDAR that the others are compared with. Default: the one with the most "
            "points. It is not taken to be in its place.",
            show_default=False,
        ),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            "--board",
            metavar="TEXT|FILE",
            help="Checks a camera too: the board that it and a LiDAR see, as "
            "checkerboard:7x5:0.095, charuco:..., aprilgrid:..., or a board file.",
        ),
    ] = None,
    board_size: Annotated[
        str | None,
        typer.Option(
            "--board-size",
            metavar="WxH",
            help="Outer edges of the plate in m, along the columns x along the rows; not needed "
            "where the board file says it.",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option("--camera", metavar="NAME", help="The camera, where the rig has several."),
    ] = None,
    lidar: Annotated[
        str | None,
        typer.Option(
            "--lidar",
            metavar="NAME",
            help="The LiDAR that the camera is checked against, where the rig has several.",
        ),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Say whether the sensors of a rig are still where it says, and which one is not.

    Each pair of sensors is calibrated anew from the new data and compared with the rig, axis by
    axis. An axis on which a planted shift of 5 cm or 1 deg would not show is not judged. Writes
    calibration.json, report.html, view.rrd and run.json into --out, and never a rig.

    Example: percept synth calib --out stops && percept calib check --rig stops/truth/rig.yaml
    --bag stops/calib.mcap --out checked
    """
    from percept.cli.calib.check_run import CheckRequest, run_check
    from percept.cli.calib.check_table import show_check

    run = run_check(
        CheckRequest(
            rig=rig,
            bags=tuple(bag or ()),
            topics=named_values(topic or [], "--topic"),
            clouds=tuple(cloud or ()),
            pairs=tuple(pair or ()),
            table=pairs,
            reference=reference,
            board=board,
            board_size=board_size,
            camera=camera,
            lidar=lidar,
            config=config,
            start_s=start,
            end_s=end,
            out=out,
            force=force,
        )
    )
    if as_json:
        typer.echo(json.dumps(run.document, indent=2, allow_nan=False))
    else:
        show_check(run.result, run.notes, out)
    raise typer.Exit(run.result.verdict.exit_code)
