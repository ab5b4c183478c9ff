"""What `percept calib lidar` prints for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from percept.calib.lidars.result import LidarCalibration, LidarExtrinsic
from percept.core.results import Verdict

__all__ = ["show_calibration"]

_HEADER = (
    "sensor", "x y z (m)", "roll pitch yaw (deg)", "sd (mm)", "sd (deg)", "scenes", "verdict",
)  # fmt: skip


def show_calibration(result: LidarCalibration, notes: Sequence[str], out: Path) -> None:
    """Print the table, the verdict with its reasons, and what to do.

    Args:
        result: The calibration.
        notes: What else should be known.
        out: The run folder.
    """
    for note in notes:
        typer.echo(note)
    rows = [_HEADER, *(_row(extrinsic) for extrinsic in result.extrinsics)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADER))]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        typer.echo("  ".join(cells).rstrip())
    for loop in result.loops:
        mark = "" if loop.agrees else " (too much)"
        typer.echo(
            f"round trip {'-'.join(loop.path)}: {100 * loop.translation_m:.1f} cm, "
            f"{loop.rotation_deg:.2f} deg{mark}"
        )
    typer.echo(f"verdict: {result.verdict}")
    for reason in result.why:
        typer.echo(f"  - {reason}")
    for text in result.advice:
        typer.echo(f"do: {text}")
    if result.verdict in (Verdict.GOOD, Verdict.DOUBTFUL):
        typer.echo(f"rig: {out / 'rig.yaml'}")
    else:
        typer.echo("no rig.yaml was written: the result is not to be used")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _row(extrinsic: LidarExtrinsic) -> tuple[str, ...]:
    placed = extrinsic.T_reference_sensor
    if placed is None:
        return extrinsic.sensor, "-", "-", "-", "-", "-", str(extrinsic.verdict)
    return (
        extrinsic.sensor,
        " ".join(f"{value:.3f}" for value in placed[:3, 3]),
        " ".join(f"{value:.2f}" for value in extrinsic.rpy_deg()),
        " ".join(f"{1000 * value:.1f}" for value in extrinsic.sd_translation_m),
        " ".join(f"{value:.3f}" for value in extrinsic.sd_rotation_deg),
        extrinsic.scenes_agreeing,
        str(extrinsic.verdict),
    )
