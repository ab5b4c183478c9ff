"""`percept lanes`: lines and stop lines of the lane, in images or in a log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from percept.cli.options import ConfigOption, EndOption, ForceOption, JsonOption, StartOption

__all__ = ["lanes"]


def lanes(
    *,
    image: Annotated[
        list[Path] | None, typer.Option("--image", help="An image. Repeat it for several.")
    ] = None,
    bag: Annotated[
        list[Path] | None,
        typer.Option("--bag", help="A log with the camera's images, instead of --image."),
    ] = None,
    topic: Annotated[
        str | None,
        typer.Option("--topic", help="The image topic of the log. Default: that of the camera."),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option("--rig", help="Rig file with the camera. Without it all is in pixels."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option("--camera", metavar="NAME", help="The camera. Default: the rig's only one."),
    ] = None,
    camera_height: Annotated[
        float | None,
        typer.Option(
            "--camera-height",
            metavar="METRES",
            help="Height over the road, where the rig does not say where the camera sits.",
        ),
    ] = None,
    method: Annotated[
        Literal["windows", "hough"] | None,
        typer.Option("--method", help="How lines are found. [default: windows]"),
    ] = None,
    lane_model: Annotated[
        Path | None,
        typer.Option(
            "--lane-model",
            metavar="FILE.onnx",
            help="A segmentation network for road lines, which makes the mask of paint.",
        ),
    ] = None,
    every: Annotated[
        int, typer.Option("--every", min=1, help="Of a log, look at every Nth image.")
    ] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Run folder with overlays, lanes.json and lanes.parquet; new or empty."
        ),
    ] = None,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find the lines of the lane and stop lines, with their types, colours and distances.

    With a camera that has a place on the vehicle, or a height, places are in metres and come with
    their spread. A line that is not there is said not to be found. Ends with 4 when there is no
    image with a line.

    Example: percept demo --out demo && percept lanes --bag demo/drive.mcap --rig demo/rig.yaml
    --camera cam_front --every 5 --out lanes
    """
    from percept.cli.lanes.request import LaneRequest
    from percept.cli.lanes.run import run_lanes
    from percept.cli.lanes.show import JsonImages, show_lanes

    request = LaneRequest(
        images=tuple(image or ()),
        bags=tuple(bag or ()),
        topic=topic,
        rig=rig,
        camera=camera,
        flags={"method": method, "camera_height_m": camera_height},
        model=lane_model,
        every=every,
        config=config,
        start_s=start,
        end_s=end,
        out=out,
        force=force,
    )
    if not as_json:
        run = run_lanes(request)
        show_lanes(run, out, each=not request.bags)
    elif len(request.images) == 1:
        run = run_lanes(request)
        typer.echo(json.dumps(run.images[0], indent=2, allow_nan=False))
    else:
        listed = JsonImages(lambda text: typer.echo(text, nl=False))
        run = run_lanes(request, listed.add)
        listed.close()
    raise typer.Exit(run.verdict.exit_code)
