"""What `percept eval lights` prints for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from percept.evaluation.lights import LightCounts, LightScores

__all__ = ["show_light_scores"]

_HEADER = ("moments", "right", "unknown", "wrong", "red as green", "changes", "delay", "flashing")


def show_light_scores(scores: LightScores, out: Path | None) -> None:
    """Print the scores by light and together, the verdict with its reasons, and what is left out.

    Args:
        scores: The scores.
        out: The run folder, where there is one.
    """
    rows: list[tuple[str, ...]] = [("light", *_HEADER)]
    rows += [(str(light), *_cells(one)) for light, one in sorted(scores.by_light.items())]
    rows.append(("all", *_cells(scores.total)))
    _print(rows)
    for line in _sentences(scores.total):
        typer.echo(line)
    for reason, count in scores.dropped.items():
        typer.echo(f"left out: {count} {reason}")
    typer.echo(f"verdict: {scores.verdict}")
    for reason in scores.why:
        typer.echo(f"  - {reason}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _cells(counts: LightCounts) -> tuple[str, ...]:
    figures = counts.document()
    return (
        str(counts.moments),
        _share(figures["state_accuracy"]),
        _share(figures["unknown_rate"]),
        str(counts.wrong),
        str(counts.red_as_green),
        str(figures["changes"]),
        _seconds(figures["delay_median_s"]),
        _flashing(counts),
    )


def _flashing(counts: LightCounts) -> str:
    said = len(counts.flash_delays_s)
    if not counts.falsely_flashing:
        return f"{said}/{said + counts.flash_missed}" if said + counts.flash_missed else "-"
    return f"{said}/{said + counts.flash_missed}, {counts.falsely_flashing} false"


def _sentences(total: LightCounts) -> list[str]:
    figures = total.document()
    lines = [
        f"{total.moments} moments at which a camera sees a light; {total.right} right, "
        f"{total.unknown} unknown, {total.unreported} of lights not reported, {total.wrong} wrong, "
        f"{total.at_a_change} more at a change not counted",
        f"red read as green: {total.red_as_green}",
    ]
    if figures["changes"]:
        lines.append(
            f"changes: {figures['changes']}, shown after {_seconds(figures['delay_median_s'])} "
            f"(median), {_seconds(figures['delay_p95_s'])} (95 %); {total.late} never"
        )
    if figures["flashing_lights"]:
        lines.append(
            f"flashing lights: {figures['flashing_lights']}, found after "
            f"{_seconds(figures['flash_delay_median_s'])} (median), "
            f"{_seconds(figures['flash_delay_p95_s'])} (95 %); {total.flash_missed} never"
        )
    lines.append(f"steady lights said to flash: {total.falsely_flashing} of {total.steady}")
    return lines


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"


def _print(rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        first = row[0].ljust(widths[0])
        rest = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        typer.echo("  ".join((first, *rest)).rstrip())
