"""What `percept eval lanes` prints for people."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from percept.cli.columns import columns
from percept.evaluation.lane_pixels import PixelLaneScores
from percept.evaluation.lane_scores import RoadLaneScores

__all__ = ["show_lane_scores"]

_BAND = ("range, m", "count", "mean abs", "mean", "95 %")
_ERRORS = ("mean_abs_m", "mean_m", "p95_abs_m")


def show_lane_scores(
    scores: RoadLaneScores | PixelLaneScores, document: Mapping[str, Any], out: Path | None
) -> None:
    """Print the scores, the verdict with its reasons, and what is left out.

    Args:
        scores: The scores.
        document: Their figures by name.
        out: The run folder, where there is one.
    """
    if isinstance(scores, RoadLaneScores):
        _show_road(document)
    else:
        _show_pixels(document)
    for reason, count in scores.dropped.items():
        typer.echo(f"left out: {count} {reason}")
    typer.echo(f"verdict: {scores.verdict}")
    for reason in scores.why:
        typer.echo(f"  - {reason}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _show_road(document: Mapping[str, Any]) -> None:
    typer.echo("lines, error across the road in m")
    typer.echo("\n".join(columns([_BAND, *_band_rows(document["lateral_error_m"])])))
    typer.echo("stop lines, error along the road in m")
    found = document["stop_lines_found_share"]
    rows = [(*row, _share(found[row[0]])) for row in _band_rows(document["stop_line_error_m"])]
    typer.echo("\n".join(columns([(*_BAND, "found"), *rows])))
    typer.echo(
        f"{document['frames']} images; both lines of the lane in "
        f"{_share(document['both_sides_share'])}, stray points {_share(document['stray_share'])}, "
        f"{document['false_stop_lines']} false stop lines"
    )
    typer.echo(f"{document['length_m']:.0f} m of lines seen on lines of the road")
    for name in ("type", "colour"):
        right, unknown = document[f"{name}_share"], document[f"unknown_{name}_share"]
        typer.echo(f"{name} right for {_share(right)} of them, unknown for {_share(unknown)}")


def _band_rows(bands: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [
        (band, str(one["count"]), *("-" if one[k] is None else f"{one[k]:.3f}" for k in _ERRORS))
        for band, one in bands.items()
    ]


def _show_pixels(document: Mapping[str, Any]) -> None:
    rows = [("image", "accuracy", "FP", "FN")]
    named = [*document["by_image"].items(), ("all", document)]
    rows += [(n, _share(one["accuracy"]), _share(one["fp"]), _share(one["fn"])) for n, one in named]
    typer.echo("\n".join(columns(rows)))
    if document["ego_rows"]:
        typer.echo(
            f"the two lines of the lane: {_share(document['ego_share'])} of "
            f"{document['ego_rows']} rows within 20 px"
        )


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
