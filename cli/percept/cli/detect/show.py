"""What `percept detect` says on the screen about a finished run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from percept.cli.track.show import show_over_time

__all__ = ["show_run"]


def show_run(run: Mapping[str, Any], out: Path) -> None:
    """Print a run in a few lines; what was left out goes to stderr.

    Args:
        run: The content of its `run.json`.
        out: The run folder.
    """
    counts, config = run["counts"], run["config"]
    if "frames" in counts:
        _show_scans(counts, config["sensors"])
    if "images" in counts:
        _show_images(counts, config["models"])
    show_over_time(counts)
    for reason, count in run["dropped"].items():
        typer.echo(f"left out: {count} x {reason}", err=True)
    typer.echo(f"verdict: {run['verdict']}: {'; '.join(run['why'])}")
    typer.echo(f"look at it: {out / 'report.html'}, or `percept view {out}`")


def _show_scans(counts: Mapping[str, Any], sensors: list[dict[str, Any]]) -> None:
    labels = _listed(counts["labels"])
    ground = counts["ground_points"] / max(counts["points"], 1)
    typer.echo(f"{counts['frames']} scans, {counts['objects']} boxes ({labels})")
    for sensor in sensors:
        typer.echo(f"{sensor['name']}: {', '.join(sensor['topics'])}; {_mounting(sensor)}")
    typer.echo(f"{ground:.0%} of {counts['points']} points are ground")


def _show_images(counts: Mapping[str, Any], models: Mapping[str, Any]) -> None:
    text = f"{counts['images']} images, {counts['images_per_s']:g} a second"
    if "frames" in counts:
        text += f", {sum(counts['boxes_2d_placed'].values())} boxes with a place in space"
    typer.echo(text)
    for name, model in models.items():
        labels: Counter[str] = Counter()
        for found in counts["boxes_2d"][name].values():
            labels.update(found)
        width, height = model["input_size"]
        classes = "unnamed" if model["class_count"] is None else model["class_count"]
        rate = "every image" if model["every"] == 1 else f"one image in {model['every']}"
        typer.echo(
            f"{name}: {model['layout']}, {classes} classes, "
            f"{'up to ' if model['rectangles'] else ''}{width}x{height} "
            f"{model['pixels']} on {model['device']}, {rate}; "
            f"{labels.total()} boxes ({_listed(labels)})"
        )


def _listed(labels: Mapping[str, int]) -> str:
    pairs = sorted(labels.items(), key=lambda pair: (-pair[1], pair[0]))
    return ", ".join(f"{count} {label}" for label, count in pairs) or "none"


def _mounting(sensor: Mapping[str, Any]) -> str:
    origin = "the base frame" if sensor["in_base_frame"] else "the sensor"
    text = f"{origin} is {sensor['height_m']:.2f} m over the ground"
    if sensor["found_height_m"] is None:
        return f"{text} as given; no ground plane was found"
    spread = f"+- {sensor['found_height_sd_m']:.2f} m"
    if sensor["height_m"] == sensor["found_height_m"]:
        text += f" ({spread})"
    else:
        text += f" as given; the scans show {sensor['found_height_m']:.2f} {spread}"
    return f"{text}, tilted {sensor['tilt_deg']:.1f} deg"
