"""Changes planted into the map of a drive: the map is wrong, the road stays as it is."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from percept.core.errors import UsageError
from percept.core.map_findings import Kind
from percept.datasets.synthetic.lanelet_map import (
    BORDERS,
    StreetMap,
    add_head,
    border_id,
    signal_rule_id,
    stop_line_id,
)
from percept.datasets.synthetic.map_sight import DriveSight
from percept.datasets.synthetic.map_sites import (
    BAR_Y_M,
    HeadSite,
    LineSite,
    Site,
    StopLineSite,
    choose_sites,
    sites_of_drive,
)
from percept.datasets.synthetic.terrain import STOP_LINE_WIDTH_M

__all__ = ["MapChange", "plan_changes", "plant_changes", "write_changes"]

Point = tuple[float, float, float]

_STREAM = 60
_TRIES, _TRIES_LONGER = 40, 3
_LINE_SHIFT_M, _BAR_SHIFT_M = (0.5, 0.9), (0.8, 1.5)
_TO_VIRTUAL, _ADDED_LINES, _ADDED_BARS = 100_000, 600_000, 700_000
_RETYPED = {"solid": "dashed", "dashed": "solid", "solid_solid": "solid"}
_RECOLOURED = {"white": "yellow", "yellow": "white"}
_LONGEST_S, _LONGER = 3600.0, 1.15


@dataclass(frozen=True, slots=True, kw_only=True)
class MapChange:
    """One change, told as the finding that it is to give; see `core.map_findings.Discrepancy`.

    Attributes:
        kind: In what way map and road disagree.
        map_element_id: Element of the written map: for a line that was removed the unpainted
            border in its place; 0 where the map has none.
        removed_element_id: Element that the map would have; 0 where nothing was removed.
        offset_m: How far the road's paint lies left of the map's, or for stop lines beyond it;
            NaN where it means nothing.
        expected: What the map says, in words.
        observed: What is on the road, in words.
        points_map: What is there in the map frame: on the road, or else in the map.
    """

    kind: Kind
    map_element_id: int
    removed_element_id: int = 0
    offset_m: float = math.nan
    expected: str
    observed: str
    points_map: Sequence[Point]

    def row(self) -> dict[str, Any]:
        """Return its columns as `discrepancies.parquet` names them; no number is null."""
        points = np.array(self.points_map)[:, :2]
        x, y = ((points[0] + points[-1]) / 2).tolist()
        along = self.kind.startswith("stop_line") or self.kind.startswith("traffic_light")
        row: dict[str, Any] = {
            "kind": str(self.kind),
            "map_element_id": self.map_element_id,
            "along_m": 0.0,
            "offset_m": None if math.isnan(self.offset_m) else round(self.offset_m, 6),
            "length_m": 0.0 if along else round(math.dist(points[0], points[-1]), 6),
            "expected": self.expected,
            "observed": self.observed,
            "x": x,
            "y": y,
            "points": points.tolist(),
        }
        return row | (
            {"removed_element_id": self.removed_element_id} if self.removed_element_id else {}
        )


def plan_changes(sight: DriveSight, blocks: Callable[[float], range], count: int) -> list[Site]:
    """Choose where changes are planted, the same for the same world and length of drive.

    Args:
        sight: What the front camera sees during the drive.
        blocks: The blocks of the map of a drive of some seconds.
        count: How many changes.

    Raises:
        UsageError: If fewer fit; the message says how many, and how long a drive takes them.
    """
    chosen = _fitting(sight, blocks, count, _TRIES)
    if len(chosen) < count:
        needed = _seconds_needed(sight, blocks, count, len(chosen))
        raise UsageError(
            f"a drive of {sight.seconds:g} s has places for {len(chosen)} changes",
            where=f"--map-changes {count}",
            remedy=f"Ask for at most {len(chosen)}, or for --seconds {needed:g}"
            if needed
            else f"Ask for at most {len(chosen)}",
        )
    return chosen


def plant_changes(
    street: StreetMap, sight: DriveSight, sites: Sequence[Site], seed: int
) -> list[MapChange]:
    """Change a map at some sites and return what was changed.

    Args:
        street: The map, which is changed.
        sight: The drive.
        sites: Where, as planned.
        seed: Of the drive.
    """
    rng = np.random.default_rng([seed, _STREAM, 1])
    return [_plant(street, sight, site, number, rng) for number, site in enumerate(sites)]


def write_changes(changes: Sequence[MapChange], path: Path) -> None:
    """Write changes as a JSON list of rows."""
    text = json.dumps([change.row() for change in changes], indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _fitting(
    sight: DriveSight, blocks: Callable[[float], range], count: int, tries: int
) -> list[Site]:
    verdicts: dict[Site, bool] = {}

    def is_seen(site: Site) -> bool:
        if site not in verdicts:
            verdicts[site] = site.seen(sight)
        return verdicts[site]

    sites = sites_of_drive(sight.world, blocks(sight.seconds), sight.span_m)
    rng = np.random.default_rng([sight.world.seed, _STREAM])
    return choose_sites(sites, count, is_seen, rng, tries)


def _seconds_needed(
    sight: DriveSight, blocks: Callable[[float], range], count: int, fitting: int
) -> float:
    """Return a length of the drive, in whole 5 s, that has places for all; 0 if none is known."""
    seconds = sight.seconds * count / max(fitting, 1)
    while seconds <= _LONGEST_S:
        seconds = 5.0 * math.ceil(seconds / 5.0)
        longer = DriveSight(sight.world, sight.ego, sight.camera, seconds)
        if len(_fitting(longer, blocks, count, _TRIES_LONGER)) == count:
            return seconds
        seconds *= _LONGER
    return 0.0


def _plant(
    street: StreetMap, sight: DriveSight, site: Site, number: int, rng: np.random.Generator
) -> MapChange:
    if isinstance(site, LineSite):
        if site.kind is Kind.MISSING_ON_ROAD:
            return _add_line(street, sight, site, number, rng)
        return _change_line(street, site, rng)
    if isinstance(site, StopLineSite):
        if site.kind is Kind.STOP_LINE_MISSING:
            return _add_stop_line(street, sight, site, number)
        return _change_stop_line(street, site, rng)
    if isinstance(site, HeadSite):
        return _change_head(street, sight, site)
    raise TypeError(f"no way to change a map at a {type(site).__name__}")


def _change_line(street: StreetMap, site: LineSite, rng: np.random.Generator) -> MapChange:
    line = border_id(site.piece, site.track // 2)
    tags = street.ways[line][1]
    points, on_road = _points(street, line), _words(tags)
    if site.kind is Kind.MISSING_IN_MAP:
        return MapChange(
            kind=site.kind,
            map_element_id=_make_virtual(street, line),
            removed_element_id=line,
            expected="no line",
            observed=on_road,
            points_map=points,
        )
    offset_m = math.nan
    if site.kind is Kind.MOVED:
        shift_m = _draw_shift(_LINE_SHIFT_M, rng)
        street.way(line, [(x, y + shift_m, z) for x, y, z in points], tags)
        offset_m = -shift_m
    elif site.kind is Kind.TYPE:
        tags["subtype"] = _RETYPED[tags["subtype"]]
        tags["lane_change"] = "yes" if tags["subtype"] == "dashed" else "no"
    else:
        tags["color"] = _RECOLOURED[tags["color"]]
    return MapChange(
        kind=site.kind,
        map_element_id=line,
        offset_m=offset_m,
        expected=_words(tags),
        observed=on_road,
        points_map=points,
    )


def _make_virtual(street: StreetMap, line: int) -> int:
    """Put a border that nobody paints in the place of a line, and return its id."""
    nodes, _ = street.ways.pop(line)
    virtual = line + _TO_VIRTUAL
    street.ways[virtual] = (nodes, {"type": "virtual", "lane_change": "no"})
    for members, _tags in street.relations.values():
        members[:] = [
            (kind, role, virtual if (kind, ref) == ("way", line) else ref)
            for kind, role, ref in members
        ]
    return virtual


def _add_line(
    street: StreetMap, sight: DriveSight, site: LineSite, number: int, rng: np.random.Generator
) -> MapChange:
    ends = np.array([site.piece.start_m, site.piece.end_m])
    heights = sight.world.profile.height(ends)
    points = [(float(x), site.y_m, float(z)) for x, z in zip(ends, heights, strict=True)]
    subtype = ("solid", "dashed")[int(rng.integers(2))]
    tags = dict(BORDERS[0].tags) | {"subtype": subtype}
    tags["lane_change"] = "yes" if subtype == "dashed" else "no"
    return MapChange(
        kind=site.kind,
        map_element_id=street.way(_ADDED_LINES + number, points, tags),
        expected=_words(tags),
        observed="no line",
        points_map=points,
    )


def _change_stop_line(street: StreetMap, site: StopLineSite, rng: np.random.Generator) -> MapChange:
    line = stop_line_id(site.block)
    points = _points(street, line)
    if site.kind is Kind.STOP_LINE_MOVED:
        shift_m = _draw_shift(_BAR_SHIFT_M, rng)
        street.way(line, [(x + shift_m, y, z) for x, y, z in points], street.ways[line][1])
        return MapChange(
            kind=site.kind,
            map_element_id=line,
            offset_m=-shift_m,
            expected="a stop line",
            observed="a stop line",
            points_map=points,
        )
    _remove_way(street, line)
    return MapChange(
        kind=site.kind,
        map_element_id=0,
        removed_element_id=line,
        expected="no stop line",
        observed="a stop line",
        points_map=points,
    )


def _add_stop_line(
    street: StreetMap, sight: DriveSight, site: StopLineSite, number: int
) -> MapChange:
    z = float(sight.world.profile.height(site.x_m))
    points = [(site.x_m, y, z) for y in BAR_Y_M]
    tags = {"type": "stop_line", "width": f"{STOP_LINE_WIDTH_M:.2f}"}
    return MapChange(
        kind=site.kind,
        map_element_id=street.way(_ADDED_BARS + number, points, tags),
        expected="a stop line",
        observed="no stop line",
        points_map=points,
    )


def _change_head(street: StreetMap, sight: DriveSight, site: HeadSite) -> MapChange:
    light = site.head.object_id
    if site.kind is Kind.TRAFFIC_LIGHT_MISSING:
        add_head(street, sight.world, signal_rule_id(site.block), site.head)
        return MapChange(
            kind=site.kind,
            map_element_id=light,
            expected="a traffic light",
            observed="no traffic light",
            points_map=_points(street, light),
        )
    points = _points(street, light)
    for way, (_, tags) in list(street.ways.items()):
        if way == light or tags.get("traffic_light_id") == str(light):
            _remove_way(street, way)
    return MapChange(
        kind=site.kind,
        map_element_id=0,
        removed_element_id=light,
        expected="no traffic light",
        observed="a traffic light",
        points_map=points,
    )


def _remove_way(street: StreetMap, way: int) -> None:
    del street.ways[way]
    for members, _ in street.relations.values():
        members[:] = [member for member in members if member[::2] != ("way", way)]


def _points(street: StreetMap, way: int) -> list[Point]:
    return [street.nodes[node] for node in street.ways[way][0]]


def _words(tags: dict[str, str]) -> str:
    return f"{tags['subtype']} {tags['color']} line"


def _draw_shift(span_m: tuple[float, float], rng: np.random.Generator) -> float:
    return float(rng.uniform(*span_m)) * float(rng.choice([-1.0, 1.0]))
