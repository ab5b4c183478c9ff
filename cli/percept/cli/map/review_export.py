"""What `percept map review --export` writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import typer

from percept.cli.run_folder import describe_input
from percept.core.errors import InputError, UsageError
from percept.core.map_findings import Status
from percept.hdmap.osm import OsmWay, read_osm
from percept.hdmap.osm_write import LayerFeature, write_osm_change, write_osm_layer
from percept.review import ReviewRun, read_run
from percept.review.exports import (
    Standing,
    finding_tags,
    places_of,
    standing,
    tag_changes,
    write_decisions_csv,
    write_decisions_json,
)
from percept.review.server import DECISIONS
from percept.review.store import read_entries

__all__ = ["export_review"]

_NAMES = ("decisions.csv", "decisions.json", "confirmed.osm", "confirmed.osc")
_MAP = ".osm"


def export_review(folder: Path, out: Path, map_file: Path | None, *, force: bool) -> None:
    """Write what was decided about a run, and say what stands in which file.

    Args:
        folder: The run.
        out: Folder for the files; made if it does not exist.
        map_file: The map; None takes the one that the run names.
        force: Whether files of these names are written over.

    Raises:
        UsageError: If files are there already, or `out` cannot be written.
        InputError: If the run, its decisions or the map cannot be read.
    """
    run = read_run(folder)
    decisions = folder / DECISIONS
    stands = standing(run, read_entries(decisions) if decisions.is_file() else [])
    confirmed = [one for one in stands if one.status is Status.CONFIRMED]
    places = places_of(folder)
    changes = tag_changes(run, confirmed)
    ways = _changed_ways(run, changes.tags, map_file)
    _make_room(out, force=force)
    write_decisions_csv(out / _NAMES[0], stands)
    write_decisions_json(out / _NAMES[1], stands)
    layer = _layer(confirmed, places)
    write_osm_layer(out / _NAMES[2], layer)
    write_osm_change(out / _NAMES[3], ways)
    typer.echo(f"{out / _NAMES[0]} and .json: {len(stands)} of {len(run.findings)} are decided")
    nowhere = len(confirmed) - len(layer)
    lacking = f"; {nowhere} without a place on earth are not in it" if nowhere else ""
    typer.echo(f"{out / _NAMES[2]}: {len(layer)} confirmed findings{lacking}")
    get = "1 way gets" if len(ways) == 1 else f"{len(ways)} ways get"
    typer.echo(f"{out / _NAMES[3]}: {get} other tags")
    for reason, count in sorted(changes.left.items()):
        typer.echo(f"  left to an editor: {count} ({reason})")


def _layer(
    confirmed: list[Standing], places: Mapping[str, tuple[tuple[float, float], ...]]
) -> list[LayerFeature]:
    return [
        LayerFeature(places[one.finding.finding_id], finding_tags(one))
        for one in confirmed
        if places.get(one.finding.finding_id)
    ]


def _changed_ways(
    run: ReviewRun, tags: Mapping[int, Mapping[str, str]], map_file: Path | None
) -> dict[int, OsmWay]:
    """Return ways as they shall be; the map is read only if there is something to change."""
    if not tags:
        return {}
    path = map_file or _map_of(run)
    ways = read_osm(path).ways
    missing = sorted(set(tags) - set(ways))
    if missing:
        raise InputError(
            f"has no way {missing[0]}, which the run speaks of",
            where=path,
            remedy="Give the map that was validated with --map",
        )
    return {
        identity: OsmWay(nodes=ways[identity].nodes, tags={**ways[identity].tags, **changed})
        for identity, changed in tags.items()
    }


def _map_of(run: ReviewRun) -> Path:
    """Return the map that a run read, if it is still the same."""
    inputs: list[dict[str, Any]] = [
        entry for entry in run.info.get("inputs", []) if str(entry.get("path", "")).endswith(_MAP)
    ]
    remedy = "Give it with --map"
    if not inputs:
        raise InputError("names no map of this format (.osm)", where=run.folder, remedy=remedy)
    path = Path(inputs[0]["path"])
    if not path.is_file():
        raise InputError("the map that was validated is not there", where=path, remedy=remedy)
    if describe_input(path) != inputs[0]:
        raise InputError(
            "was changed since it was validated",
            where=path,
            remedy="Validate again, or give the map as it was with --map",
        )
    return path


def _make_room(out: Path, *, force: bool) -> None:
    there = [name for name in _NAMES if (out / name).exists()]
    if there and not force:
        raise UsageError(f"holds {there[0]} already", where=out, remedy="Give another, or --force")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"cannot be made ({error.strerror})", where=out, remedy="Give a folder to --export"
        ) from error
