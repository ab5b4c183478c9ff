"""`percept synth`: logs of a synthetic world, with exact truth."""

from __future__ import annotations

import json
from typing import Annotated, Literal

import typer

from percept.cli.options import ForceOption, JsonOption, OutOption

__all__ = ["app"]


_CAMERA_NAMES = {
    "front": ("cam_front",),
    "all": ("cam_front", "cam_left", "cam_right", "cam_rear"),
    "none": (),
}

NoiseOption = Annotated[
    float,
    typer.Option(
        "--noise", min=0, max=10, help="Scale of all sensor noise; 0 makes everything exact."
    ),
]
FormatOption = Annotated[
    Literal["mcap", "rosbag1", "rosbag2"],
    typer.Option("--format", help="Kind of log that is written."),
]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)


@app.callback()
def synth() -> None:
    """Make logs of a synthetic world, with exact truth beside them.

    Example: percept synth drive --seconds 0.5 --out world
    """


@app.command()
def drive(
    *,
    out: OutOption,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Which world and drive.")] = 0,
    seconds: Annotated[
        float, typer.Option("--seconds", min=0.1, max=3600, help="Length of the drive.")
    ] = 3.0,
    noise: NoiseOption = 1.0,
    log_format: FormatOption = "mcap",
    cameras: Annotated[
        Literal["front", "all", "none"],
        typer.Option("--cameras", help="Which cameras to render."),
    ] = "front",
    map_changes: Annotated[
        int,
        typer.Option(
            "--map-changes",
            min=0,
            max=10_000,
            help="Plant this many changes into the map; the road stays as it is.",
        ),
    ] = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a drive: 4 LiDARs, cameras, GNSS and INS, an HD map, and the truth of it all.

    Writes the log, rig.yaml, map.osm and truth/ into --out. The same seed gives the same samples.
    With --map-changes the map is wrong in that many places, which truth/map_changes.json lists.

    Example: percept synth drive --seconds 1 --out street
    """
    from percept.cli.synth_run import make_drive
    from percept.core.settings import parse_settings
    from percept.datasets.synthetic.drive import DriveConfig

    config = parse_settings(
        DriveConfig,
        {
            "seed": seed,
            "seconds": seconds,
            "noise": noise,
            "cameras": _CAMERA_NAMES[cameras],
            "map_changes": map_changes,
        },
        where="flags",
    )
    run = make_drive(out, config, log_format, force=force)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        typer.echo(f"{out}: {run['counts']['messages']} messages, {seconds:g} s, seed {seed}")


@app.command()
def calib(
    *,
    out: OutOption,
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Which street, rig errors, poses and noise.")
    ] = 0,
    stops: Annotated[
        int, typer.Option("--stops", min=1, max=20, help="Places at which the vehicle stands.")
    ] = 5,
    poses: Annotated[
        int,
        typer.Option(
            "--poses", min=1, max=200, help="Poses of the board for each camera, over all places."
        ),
    ] = 32,
    noise: NoiseOption = 1.0,
    log_format: FormatOption = "mcap",
    cameras: Annotated[
        Literal["front", "all", "none"],
        typer.Option("--cameras", help="Which cameras the board is shown to."),
    ] = "front",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a calibration log: stops with a board in view, a wrong rig, and the truth.

    Writes the log, rig.yaml (the wrong one), board.yaml and truth/ into --out. The same seed
    gives the same samples.

    Example: percept synth calib --stops 2 --poses 2 --out rig
    """
    from percept.cli.synth_run import make_calibration
    from percept.core.settings import parse_settings
    from percept.datasets.synthetic.calibration.capture import CalibrationConfig

    flags = {"seed": seed, "stops": stops, "poses": poses, "noise": noise}
    config = parse_settings(
        CalibrationConfig, {**flags, "cameras": _CAMERA_NAMES[cameras]}, where="flags"
    )
    run = make_calibration(out, config, log_format, force=force)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        typer.echo(
            f"{out}: {run['counts']['messages']} messages, {stops} stops, "
            f"{run['counts']['poses']} poses of the board, seed {seed}"
        )
