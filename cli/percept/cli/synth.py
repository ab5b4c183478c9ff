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
    noise: Annotated[
        float,
        typer.Option(
            "--noise", min=0, max=10, help="Scale of all sensor noise; 0 makes everything exact."
        ),
    ] = 1.0,
    log_format: Annotated[
        Literal["mcap", "rosbag1", "rosbag2"],
        typer.Option("--format", help="Kind of log that is written."),
    ] = "mcap",
    cameras: Annotated[
        Literal["front", "all", "none"],
        typer.Option("--cameras", help="Which cameras to render."),
    ] = "front",
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Make a drive: 4 LiDARs, cameras, GNSS and INS, an HD map, and the truth of it all.

    Writes the log, rig.yaml, map.osm and truth/ into --out. The same seed gives the same samples.

    Example: percept synth drive --seconds 1 --out street
    """
    from percept.cli.synth_run import make_drive
    from percept.core.settings import parse_settings
    from percept.datasets.synthetic.drive import DriveConfig

    config = parse_settings(
        DriveConfig,
        {"seed": seed, "seconds": seconds, "noise": noise, "cameras": _CAMERA_NAMES[cameras]},
        where="flags",
    )
    run = make_drive(out, config, log_format, force=force)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        typer.echo(f"{out}: {run['counts']['messages']} messages, {seconds:g} s, seed {seed}")
