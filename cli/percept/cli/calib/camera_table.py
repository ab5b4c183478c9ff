"""What `percept calib camera` prints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from percept.calib.intrinsics.result import CameraFit
    from percept.cli.calib.camera_run import CameraRun

__all__ = ["show_calibration"]

_MOST_NAMED = 12


def show_calibration(run: CameraRun, out: Path) -> None:
    """Print a calibration: the camera, what was left out, the verdict, and what to do."""
    result = run.result
    used = sum(view.used for view in result.views)
    typer.echo(
        f"{result.name}: {used} of {len(result.views)} views used; "
        f"{run.looked_at} images looked at, the board searched in {run.searched}"
    )
    if result.fit is not None:
        _show_fit(result.fit)
    left_out = [view for view in result.views if view.reason is not None]
    for view in left_out[:_MOST_NAMED]:
        typer.echo(f"left out: {view.name}: {view.reason}", err=True)
    if len(left_out) > _MOST_NAMED:
        rest = len(left_out) - _MOST_NAMED
        typer.echo(f"left out: {rest} more, see the report", err=True)
    typer.echo(f"verdict: {result.verdict}: {'; '.join(result.why)}")
    for advice in result.advice:
        typer.echo(f"to do: {advice}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _show_fit(fit: CameraFit) -> None:
    K, sd = fit.camera.K, fit.sd
    width, height = fit.camera.image_size
    typer.echo(
        f"{fit.camera.model}, {width}x{height}: fx {K[0, 0]:.2f} +- {sd['fx']:.2f}, "
        f"fy {K[1, 1]:.2f} +- {sd['fy']:.2f}, cx {K[0, 2]:.2f} +- {sd['cx']:.2f}, "
        f"cy {K[1, 2]:.2f} +- {sd['cy']:.2f} px"
    )
    numbers = ", ".join(f"{value:.5g}" for value in fit.camera.distortion)
    typer.echo(f"distortion {numbers}")
