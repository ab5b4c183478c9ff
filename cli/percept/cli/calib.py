"""`percept calib`: calibrate the sensors of a vehicle, and say how good the result is."""

from __future__ import annotations

import typer

from percept.cli import calib_camera, calib_camera_lidar, calib_check, calib_export, calib_lidar

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
app.command("lidar")(calib_lidar.lidar)
app.command("camera")(calib_camera.camera)
app.command("camera-lidar")(calib_camera_lidar.camera_lidar)
app.command("check")(calib_check.check)
app.command("export")(calib_export.export)


@app.callback()
def calib() -> None:
    """Calibrate LiDARs and cameras from a log or files, with an uncertainty and a verdict.

    Example: percept calib --help
    """
