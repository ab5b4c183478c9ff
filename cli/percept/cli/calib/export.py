"""`percept calib export`: a rig in the files of other tools."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from percept.cli.options import ForceOption, JsonOption, OutOption

__all__ = ["export"]

_Format = Literal[
    "ros-camera-info", "ros-tf", "urdf", "kalibr", "kitti", "opencv", "autoware", "rig"
]


def export(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG",
            help="A rig.yaml, the folder of a calibration run, or a file of another tool: "
            "ROS CameraInfo, static transforms, URDF, Kalibr, KITTI, OpenCV, Autoware.",
            show_default=False,
        ),
    ],
    *,
    rig_format: Annotated[
        _Format,
        typer.Option(
            "--format", help="Whose files to write; 'rig' imports a file into a rig.yaml."
        ),
    ],
    out: OutOption,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a calibration for ROS, Autoware, Kalibr, KITTI or OpenCV, or import one from there.

    Every transform is written in both directions, with its frames in words. What the format
    cannot hold is named. The verdict is that of the calibration, where the rig lies beside one.

    Example: percept demo --out demo && percept calib export demo/rig.yaml --format ros-tf --out tf
    """
    from percept.cli.calib.export_run import run_export

    run = run_export(rig, rig_format, out, force=force)
    if as_json:
        typer.echo(json.dumps(run, indent=2))
    else:
        _show(run, out)
    raise typer.Exit(run["exit_code"])


def _show(run: dict[str, Any], out: Path) -> None:
    for name in run["files"]:
        typer.echo(str(out / name))
    for reason in run["dropped"]:
        typer.echo(f"mind: {reason}", err=True)
    typer.echo(f"verdict: {run['verdict']}: {'; '.join(run['why'])}")
