"""What `percept calib camera-lidar` prints."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import typer

from percept.calib.camera_lidar.result import CameraLidarCalibration
from percept.core.results import Verdict
from percept.core.transform import quat_xyzw_from_matrix

__all__ = ["show_calibration"]


def show_calibration(result: CameraLidarCalibration, notes: tuple[str, ...], out: Path) -> None:
    """Print a calibration for a person.

    Args:
        result: The calibration.
        notes: What a user should know beside it.
        out: The run folder.
    """
    used = sum(pair.used for pair in result.pairs)
    for note in notes:
        typer.echo(note)
    typer.echo(f"{used} of {len(result.pairs)} pairs used")
    for pair in result.pairs:
        if not pair.used:
            typer.echo(f"left out: {pair.name}: {pair.reason}", err=True)
    _show_transform(result)
    typer.echo(f"verdict: {result.verdict}: {'; '.join(result.why)}")
    for advice in result.advice:
        typer.echo(f"to do: {advice}")
    if result.verdict in (Verdict.GOOD, Verdict.DOUBTFUL):
        typer.echo(f"rig: {out / 'rig.yaml'}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _show_transform(result: CameraLidarCalibration) -> None:
    T = result.T_camera_lidar
    if T is None or result.sd_translation_m is None or result.sd_rotation_deg is None:
        return
    quat_xyzw = quat_xyzw_from_matrix(T[:3, :3])
    typer.echo("T_camera_lidar (maps points of the LiDAR's frame into the camera's):")
    typer.echo(f"  translation {_row(T[:3, 3], 4)} m, quaternion x y z w {_row(quat_xyzw, 6)}")
    typer.echo(
        "  standard deviation along and about the camera's x, y, z: "
        f"{_row(1000 * result.sd_translation_m, 1)} mm, {_row(result.sd_rotation_deg, 3)} deg"
    )
    if result.range_offset_m is not None:
        typer.echo(
            f"  range offset of the LiDAR: {1000 * result.range_offset_m.value:+.1f} mm, to be "
            "added to its ranges"
        )


def _row(values: Iterable[float], digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
