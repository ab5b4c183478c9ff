"""`percept detect`: objects in a log."""

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
    StartOption,
    named_values,
)
from percept.cli.track.command import MapOption, OriginOption
from percept.core.errors import UsageError

__all__ = ["detect"]

BagOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--bag",
        help="The log: a ROS 1 .bag, a ROS 2 folder, a bare .db3 or .mcap, or a folder of "
        "scans. Repeat it for several logs of one drive.",
        show_default=False,
    ),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Run folder; new or empty.", show_default=False)
]
RigOption = Annotated[
    Path | None,
    typer.Option(
        "--rig", help="Rig file: sensors, intrinsics and where they sit; wins over the log's own."
    ),
]
TopicOption = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="[SENSOR=]TOPIC",
        help="Use this LiDAR or camera topic, under this name. Repeat it for several.",
    ),
]
LidarsOption = Annotated[
    Literal["merge", "separate"] | None,
    typer.Option(
        "--lidars",
        help="Several LiDARs: one merged cloud in the vehicle's frame, or each by itself. "
        "Default: merge where the place of every one is known.",
        show_default=False,
    ),
]
HeightOption = Annotated[
    float | None,
    typer.Option(
        "--sensor-height",
        metavar="METRES",
        help="Height of the sensor over the ground; measured in the scans where not given.",
    ),
]
RulesOption = Annotated[
    Path | None, typer.Option("--rules", help="YAML file with the classification rules.")
]
ModelOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model",
        metavar="NAME=FILE.onnx[@every=N]",
        help="A YOLO network to run on the cameras, at every Nth image of each. FILE may be the "
        "word `builtin`: the detector that ships. Repeat it for several networks.",
    ),
]
ClassesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--classes",
        metavar="[NAME=]FILE",
        help="Class names of a model, one a line or YAML; its own where not given.",
    ),
]
LayoutOption = Annotated[
    list[str] | None,
    typer.Option(
        "--layout",
        metavar="[NAME=]LAYOUT",
        help="How a model's output is read, such as v8 or yolox; found where not given.",
    ),
]
PixelsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--pixels",
        metavar="[NAME=]FORMAT",
        help="What a model takes: rgb1, bgr255, rgb255 or bgr1; found where not given.",
    ),
]
SizeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input-size",
        metavar="[NAME=]WxH",
        help="Input of a model whose size is free, such as 1600x1088 to see farther.",
    ),
]
TilesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--tiles",
        metavar="[NAME=]CxR",
        help="Look at C x R overlapping parts of each image too, for small far objects.",
    ),
]
ScoreOption = Annotated[
    float | None,
    typer.Option("--score", help="Least confidence of a box. Default: 0.25.", show_default=False),
]
IouOption = Annotated[
    float | None,
    typer.Option(
        "--iou",
        help="Overlap from which the weaker of two boxes of a class goes. Default: 0.45.",
        show_default=False,
    ),
]
DeviceOption = Annotated[
    Literal["auto", "cpu", "cuda", "openvino"] | None,
    typer.Option("--device", help="What runs the networks. Default: auto.", show_default=False),
]
PosesOption = Annotated[
    Literal["auto", "gnss", "odometry", "pose", "tf", "lidar"] | None,
    typer.Option(
        "--poses",
        help="What tells where the vehicle was. Default: the best that the log has, and the "
        "LiDAR where it has nothing.",
        show_default=False,
    ),
]


def detect(
    ctx: typer.Context,
    *,
    bag: BagOption = None,
    out: OutOption = None,
    model: ModelOption = None,
    rig: RigOption = None,
    topic: TopicOption = None,
    lidar_only: Annotated[bool, typer.Option("--lidar-only", help="Look at no camera.")] = False,
    camera_only: Annotated[
        bool,
        typer.Option(
            "--camera-only", help="Look at no LiDAR: only depth images tell where boxes are."
        ),
    ] = False,
    lidars: LidarsOption = None,
    sensor_height: HeightOption = None,
    rules: RulesOption = None,
    classes: ClassesOption = None,
    layout: LayoutOption = None,
    pixels: PixelsOption = None,
    input_size: SizeOption = None,
    score: ScoreOption = None,
    iou: IouOption = None,
    tiles: TilesOption = None,
    device: DeviceOption = None,
    undistort: Annotated[
        bool, typer.Option("--undistort", help="Take the lens out of images; needs intrinsics.")
    ] = False,
    preview: Annotated[
        bool,
        typer.Option("--preview", help="Networks at half their input size where it is free."),
    ] = False,
    map_file: MapOption = None,
    origin: OriginOption = None,
    poses: PosesOption = None,
    no_track: Annotated[
        bool, typer.Option("--no-track", help="Detect only: no tracks, no traffic lights.")
    ] = False,
    config: ConfigOption = None,
    start: StartOption = None,
    end: EndOption = None,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write overlay.mcap for Foxglove and rviz too.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted run in --out.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Find objects in a log: 3D boxes in its LiDAR scans, 2D boxes in its images, and their tracks.

    Writes detections_3d.parquet, detections_2d.parquet, tracks.parquet, lights.parquet, view.rrd,
    report.html and run.json into --out. Nothing has to be configured: every topic with point
    clouds is used, and with --model every camera; places come from the log's tf_static, heights
    over the ground are measured, how a network is fed and read is found from the file, and where
    the vehicle was from GNSS, odometry or the LiDAR.

    Example: percept demo --out demo && percept detect --bag demo/drive.mcap
    --model small=builtin --out run
    """
    if ctx.invoked_subcommand is not None:
        _refuse_options(ctx)
        return
    if not bag or out is None:
        missing = "--bag LOG" if not bag else "--out DIR"
        raise UsageError(f"{missing} is missing", remedy="See `percept detect --help`")
    if len({path.resolve() for path in bag}) < len(bag):
        raise UsageError("--bag names a log twice", remedy="Give each log once")
    from percept.cli.detect.flags import model_flags, model_requests
    from percept.cli.detect.request import DetectRequest
    from percept.cli.detect.run import run_detection
    from percept.cli.detect.show import show_run

    models = model_requests(model or [], classes or [])
    names = [wanted.name for wanted in models]
    request = DetectRequest(
        bags=tuple(bag),
        out=out,
        rig=rig,
        topics=_named_topics(topic or []),
        models=models,
        config=config,
        flags={
            "lidars": lidars,
            "lidar": {
                "sensor_height_m": sensor_height,
                "rules": None if rules is None else str(rules),
            },
            "camera": {
                "device": device,
                "undistort": undistort or None,
                "preview": preview or None,
            },
            "models": model_flags(
                names,
                layout=layout or [],
                pixels=pixels or [],
                input_size=input_size or [],
                tiles=tiles or [],
                score=score,
                iou=iou,
                others={"--device": device, "--undistort": undistort, "--preview": preview},
            ),
        },
        start_s=start,
        end_s=end,
        track=not no_track,
        poses=poses or "auto",
        map_file=map_file,
        origin=origin,
        lidar_only=lidar_only,
        camera_only=camera_only,
        overlay=mcap,
        resume=resume,
        force=force,
    )
    run = run_detection(request)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        show_run(run, out)
    raise typer.Exit(run["exit_code"])


def _named_topics(entries: list[str]) -> dict[str, str]:
    """Split `SENSOR=TOPIC`; a bare topic is named after itself."""
    named = [e if "=" in e else f"{e.strip('/').replace('/', '_')}={e}" for e in entries]
    return named_values(named, "--topic")


def _refuse_options(ctx: typer.Context) -> None:
    """Refuse options before the name of a subcommand: they would be ignored."""
    given = [name for name, value in ctx.params.items() if value not in (None, False, [], ())]
    if given:
        option = next(p.opts[0] for p in ctx.command.params if p.name == given[0])
        raise UsageError(
            f"{option} is no option of `percept detect {ctx.invoked_subcommand}`",
            remedy="Give options behind the name of the subcommand",
        )
