"""`percept calib`: calibrate the sensors of a vehicle, and say how good the result is."""

from __future__ import annotations

import typer

from percept.cli.calib import camera, camera_lidar, check, export, lidar

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.command("lidar")(lidar.lidar)
app.command("camera")(camera.camera)
app.command("camera-lidar")(camera_lidar.camera_lidar)
app.command("check")(check.check)
app.command("export")(export.export)


@app.callback()
def calib() -> None:
    """Calibrate LiDARs and cameras from a log or files, with an uncertainty and a verdict.

    Example: percept calib --help
    """
