"""What `percept calib check` prints for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from percept.calib.check.result import AXES, AxisCheck, AxisVerdict, CalibrationCheck

__all__ = ["show_check"]

_MARKS = {AxisVerdict.HOLDS: "", AxisVerdict.MOVED: " MOVED", AxisVerdict.NOT_JUDGED: " ?"}
_HEADER = ("sensor", "against", *(f"{n} ({'cm' if n in AXES[:3] else 'deg'})" for n in AXES))


def show_check(result: CalibrationCheck, notes: Sequence[str], out: Path) -> None:
    """Print how far each sensor is off the rig, the verdict with its reasons, and what to do.

    Args:
        result: The check.
        notes: What else should be known.
        out: The run folder.
    """
    for note in notes:
        typer.echo(note)
    rows = [(*_HEADER, "verdict")]
    for pair in result.pairs:
        cells = (_cell(name, pair.axes[name]) for name in AXES)
        rows.append((pair.sensor, pair.against, *cells, str(pair.verdict)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        padded = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        typer.echo("  ".join(padded).rstrip())
    typer.echo("measured less rig, along and about x, y, z of the base; ? is not judged")
    typer.echo(f"verdict: {result.verdict}")
    for reason in result.why:
        typer.echo(f"  - {reason}")
    for text in result.advice:
        typer.echo(f"do: {text}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _cell(name: str, axis: AxisCheck) -> str:
    if axis.delta != axis.delta:  # NaN: there is no measurement
        return "-"
    if name in AXES[:3]:
        return f"{100 * axis.delta:+.1f} of {100 * axis.tolerance:.1f}{_MARKS[axis.verdict]}"
    return f"{axis.delta:+.2f} of {axis.tolerance:.2f}{_MARKS[axis.verdict]}"
