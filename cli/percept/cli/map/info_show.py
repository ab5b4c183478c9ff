"""What `percept map info` prints for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer

from percept.cli.columns import columns

__all__ = ["show_summary"]

_ELEMENTS = (
    ("points", "points"),
    ("line strings", "linestrings"),
    ("lanelets", "lanelets"),
    ("areas", "areas"),
    ("rules", "regulatory_elements"),
    ("traffic lights", "traffic_lights"),
)


def show_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """Print what a map holds.

    Args:
        path: The map's file.
        summary: As of `percept.hdmap.summary.summarise_map`.
    """
    typer.echo(f"{path}: {', '.join(f'{summary[key]} {name}' for name, key in _ELEMENTS)}")
    for title, key in (
        ("lanelets", "lanelets_by_subtype"),
        ("rules", "regulatory_elements_by_subtype"),
        ("line strings", "linestrings_by_type"),
    ):
        if summary[key]:
            counts = ", ".join(f"{count} {word}" for word, count in summary[key].items())
            typer.echo(f"{title}: {_one_line(counts)}")
    if summary["lane_km"]:
        typer.echo(f"lanes for vehicles: {summary['lane_km']:.2f} km")
    for line in _markings(summary["markings"]):
        typer.echo(line)
    typer.echo(_extent(summary["extent_m"]))
    typer.echo(_place(summary))
    for reason, count in summary["dropped"].items():
        typer.echo(f"noted: {count} {_one_line(reason)}")


def _markings(markings: list[dict[str, Any]]) -> Iterator[str]:
    if not markings:
        yield "markings: none"
        return
    rows = [("markings", "number", "length")]
    for one in markings:
        words = [one["kind"].replace("_", " "), one["type"], one["colour"]]
        said = " ".join(word for word in words if word != "unknown")
        name = said if one["painted"] else f"{said}, not painted"
        rows.append((f"  {_one_line(name)}", str(one["count"]), f"{one['length_m']:.0f} m"))
    yield from columns(rows)


def _extent(extent: Mapping[str, list[float]]) -> str:
    parts = (f"{axis} {low:.1f} ... {high:.1f}" for axis, (low, high) in extent.items())
    return f"extent: {', '.join(parts)} m"


def _place(summary: Mapping[str, Any]) -> str:
    found = summary["georeference"]
    if found is None:
        return "place: the map does not say where on the earth it lies"
    at = f"{found['latitude']:.7f}, {found['longitude']:.7f}"
    if summary["origin"] is not None:
        return f"place: east, north and up of {at}, {found['altitude']:.2f} m"
    return (
        f"place: a grid about {at}, turned by {found['rotation_deg']:.4f} deg, scale "
        f"{found['scale']:.6f} (by {found['points']} points, residual {found['residual_m']:.3f} m)"
    )


def _one_line(text: str) -> str:
    """Return a text with words of a map in it as one line that no terminal obeys."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
