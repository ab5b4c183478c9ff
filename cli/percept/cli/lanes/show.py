"""What `percept lanes` says on the screen."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from percept.cli.lanes.request import LaneRun

__all__ = ["JsonImages", "show_lanes"]


class JsonImages:
    """Writes `{"images": [...]}` piece by piece, an image a line."""

    def __init__(self, write: Callable[[str], object]) -> None:
        self._write = write
        self._lead = '{"images": [\n'

    def add(self, image: dict[str, Any]) -> None:
        """Write the JSON object of an image."""
        self._write(self._lead + json.dumps(image, allow_nan=False))
        self._lead = ",\n"

    def close(self) -> None:
        """Write the end."""
        self._write(("" if self._lead == ",\n" else self._lead) + "\n]}\n")


def show_lanes(run: LaneRun, out: Path | None, *, each: bool) -> None:
    """Print what was found, with `each` line of each image; what was left out goes to stderr."""
    for reason, count in run.dropped.items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    if each:
        _show_images(run)
    else:
        typer.echo(", ".join(f"{k.replace('_', ' ')} {n}" for k, n in run.counts.items()))
    typer.echo(f"verdict: {', '.join([run.verdict.value, *run.why])}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _show_images(run: LaneRun) -> None:
    for image in run.images:
        typer.echo(image["image"])
        for line in image["lines"]:
            typer.echo(f"  {_line(line)}")
        for stop in image["stop_lines"]:
            far, sd = stop["distance_m"], stop["sd_m"]
            place = "" if far is None else f" at {far:.1f} m (sd {sd:.2f} m)"
            typer.echo(f"  stop line{place}")
        if image["lane_width_m"] is not None:
            radius = min(image["radius_m"] / 1000, 99.9)
            typer.echo(f"  lane width {image['lane_width_m']:.2f} m, radius {radius:.1f} km")
        for note in image["notes"]:
            typer.echo(f"  note: {note}")
    more = run.counts["images"] - len(run.images)
    if more:
        typer.echo(f"and {more} more images")


def _line(line: dict[str, Any]) -> str:
    place = ""
    if line["points_m"]:
        x, y = line["points_m"][0]
        place = f", {y:+.2f} m (sd {line['sd_m'][0]:.2f} m) at {x:.1f} m ahead"
    return f"{line['side']}: {line['type']} {line['colour']}{place}, {line['confidence']:.2f}"
