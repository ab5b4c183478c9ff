"""`percept calib camera`: the intrinsics of a camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from percept.cli.options import (
    ConfigOption,
    EndOption,
    ForceOption,
    JsonOption,
    OutOption,
    StartOption,
)

__all__ = ["camera"]


def camera(
    *,
    board: Annotated[
        str,
        typer.Option(
            "--board",
            metavar="TEXT|FILE",
            help="checkerboard:COLUMNSxROWS:SQUARE in inner corners and metres, charuco:..., "
            "aprilgrid:..., or a board file.",
            show_default=False,
        ),
    ],
    out: OutOption,
    images: Annotated[
        list[str] | None,
        typer.Option(
            "--images", metavar="GLOB|DIR", help="Image files of one camera. Repeat it for more."
        ),
    ] = None,
    bag: Annotated[
        list[Path] | None,
        typer.Option("--bag", help="A log with the camera's images, instead of --images."),
    ] = None,
    topic: Annotated[
        str | None,
        typer.Option(
            "--topic",
            help="The image topic. Default: that of the camera in --initial, or the only one.",
        ),
    ] = None,
    model: Annotated[
        Literal["auto", "pinhole", "rational", "fisheye"] | None,
        typer.Option(
            "--model",
            help="Lens model. Default: what explains left-out views best.",
            show_default=False,
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            "--camera", metavar="NAME", help="Name of the camera in the rig. Default: camera."
        ),
    ] = None,
    board_warp: Annotated[
        bool, typer.Option("--board-warp", help="Estimate how the board is bent, too.")
    ] = False,
    undistort: Annotated[
        bool,
        typer.Option("--undistort", help="Write the images without distortion, and the maps."),
    ] = False,
    initial: Annotated[
        Path | None,
        typer.Option("--initial", metavar="RIG", help="Rig file to put the camera into."),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Calibrate a camera from images of a board, and say how good that is.

    Writes calibration.json, report.html, view.rrd and run.json into --out, and rig.yaml where the
    result can be used. Take 20 to 40 sharp images: the board near and far, in every corner of the
    image, tilted to all sides by 30 to 45 deg.

    Example: percept synth calib --out stops && percept calib camera --bag stops/calib.mcap
    --board stops/board.yaml --topic /cam_front/image_raw/compressed --out camera
    """
    from percept.cli.calib.camera_run import CameraRequest, run_camera_calibration
    from percept.cli.calib.camera_table import show_calibration

    request = CameraRequest(
        images=tuple(images or ()),
        bags=tuple(bag or ()),
        topic=topic,
        board=board,
        name=name,
        initial=initial,
        config=config,
        flags={"model": model, "board_warp": board_warp or None},
        undistort=undistort,
        start_s=start,
        end_s=end,
        out=out,
        force=force,
    )
    run = run_camera_calibration(request)
    if as_json:
        typer.echo(json.dumps(run.document, indent=2, allow_nan=False))
    else:
        show_calibration(run, out)
    raise typer.Exit(run.result.verdict.exit_code)
