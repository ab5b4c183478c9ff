"""`percept calib camera-lidar`: where a camera sits relative to a LiDAR."""

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
)

__all__ = ["camera_lidar"]


def camera_lidar(
    *,
    out: OutOption,
    board: Annotated[
        str,
        typer.Option(
            "--board",
            metavar="TEXT|FILE",
            help="The board: checkerboard:7x5:0.095 (inner corners along columns x rows, square "
            "in m), charuco:..., aprilgrid:..., or a board file.",
            show_default=False,
        ),
    ],
    pair: Annotated[
        list[str] | None,
        typer.Option(
            "--pair",
            metavar="IMAGE=CLOUD",
            help="An image and the cloud of the same moment: pcd, ply, KITTI bin or npy. Repeat "
            "it for every pose of the board.",
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
    bag: Annotated[
        list[Path] | None,
        typer.Option(
            "--bag",
            help="A log in which the board is held still in several poses instead: a ROS 1 .bag, "
            "a ROS 2 folder, a bare .db3 or .mcap. Repeat it for several logs.",
        ),
    ] = None,
    image_topic: Annotated[
        str | None,
        typer.Option("--image-topic", metavar="TOPIC", help="The camera in the log."),
    ] = None,
    cloud_topic: Annotated[
        str | None,
        typer.Option("--cloud-topic", metavar="TOPIC", help="The LiDAR in the log."),
    ] = None,
    intrinsics: Annotated[
        Path | None,
        typer.Option(
            "--intrinsics",
            metavar="FILE",
            help="The camera's intrinsics: rig.yaml, ROS CameraInfo, OpenCV or Kalibr. Default: "
            "those of --initial, or of the log.",
            show_default=False,
        ),
    ] = None,
    board_size: Annotated[
        str | None,
        typer.Option(
            "--board-size",
            metavar="WxH",
            help="Outer edges of the plate in m, along the columns x along the rows, such as "
            "0.85x0.61; not needed where the board file says it.",
        ),
    ] = None,
    initial: Annotated[
        Path | None,
        typer.Option(
            "--initial",
            metavar="RIG",
            help="Rig file to update: the camera is placed anew, the LiDAR stays. Its place of "
            "the camera is compared, not started from.",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option("--camera", metavar="NAME", help="The camera, where a file has several."),
    ] = None,
    lidar: Annotated[
        str | None,
        typer.Option("--lidar", metavar="NAME", help="The LiDAR, where the rig has several."),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Place a camera relative to a LiDAR from a board that both see, and say how good that is.

    No first guess and no region of interest: the board is found in the raw clouds. Writes
    calibration.json, report.html, view.rrd and run.json into --out, and rig.yaml where the result
    can be used. Show the board in ten poses or more, turned 20 to 40 deg each way, at different
    distances and places in the image.

    Example: percept synth calib --out stops && percept calib camera-lidar --bag stops/calib.mcap
    --cloud-topic /lidar_top/points --board stops/board.yaml --intrinsics stops/truth/rig.yaml
    --out front
    """
    from percept.cli.calib.camera_lidar_run import CameraLidarRequest, run_camera_lidar
    from percept.cli.calib.camera_lidar_table import show_calibration

    run = run_camera_lidar(
        CameraLidarRequest(
            pairs=tuple(pair or ()),
            table=pairs,
            bags=tuple(bag or ()),
            image_topic=image_topic,
            cloud_topic=cloud_topic,
            intrinsics=intrinsics,
            board=board,
            board_size=board_size,
            initial=initial,
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
        show_calibration(run.result, run.notes, out)
    raise typer.Exit(run.result.verdict.exit_code)
