"""Buffer zones: hatched ground that nobody drives on, drawn between lanes and over none."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.area import flaw_of, polygons_of
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule

__all__ = ["BUFFER_ZONE"]

_NAME = "mapping.area.buffer_zone_validity"
_KIND = "hatched_road_markings"
_ROADS = ("road", "road_shoulder")
_LARGEST_OVERLAP = 0.01
"""Share of the zone that a road may cover: borders are drawn by hand."""

_POINTS = IssueCode(
    "Area.BufferZoneValidity-001",
    _NAME,
    "Error",
    "polygon",
    "Draw it along the borders of the lanelets around it, with their points",
)
_OUTLINE = IssueCode(
    "Area.BufferZoneValidity-002",
    _NAME,
    "Error",
    "polygon",
    "Draw it as one closed line that does not cross itself",
)
_OVERLAP = IssueCode(
    "Area.BufferZoneValidity-003",
    _NAME,
    "Warning",
    "polygon",
    "Draw it beside the lanelet, unless that joins from a side street",
)


def _find(checked: CheckedMap) -> Iterator[MapIssue]:
    for zone in polygons_of(checked, _KIND):
        yield from _own_points(checked, zone)
        flaw = flaw_of(checked, zone)
        if flaw is None:
            yield from _overlaps(checked, zone)
        else:
            # What a line that crosses itself encloses is anybody's guess: no overlap is asked.
            yield _OUTLINE.at(zone, flaw)


def _own_points(checked: CheckedMap, zone: int) -> Iterator[MapIssue]:
    near = [checked.hd_map.lanelets[i] for i in checked.lanelets_near(checked.ground(zone))]
    shared = {node for lanelet in near for node in (*lanelet.left_nodes, *lanelet.right_nodes)}
    own = [node for node in checked.hd_map.line_strings[zone].nodes if node not in shared]
    if own:
        points = ", ".join(map(str, dict.fromkeys(own)))
        yield _POINTS.at(zone, f"has points that no lanelet beside it has: {points}")


def _overlaps(checked: CheckedMap, zone: int) -> Iterator[MapIssue]:
    ground = checked.ground(zone)
    for lanelet in checked.lanelets_near(ground):
        subtype = checked.hd_map.lanelets[lanelet].subtype
        if subtype not in _ROADS:
            continue
        share = ground.intersection(checked.lanelet_ground(lanelet)).area / ground.area
        if share > _LARGEST_OVERLAP:
            yield _OVERLAP.at(zone, f"lies to {share:.0%} on {subtype} lanelet {lanelet}")


BUFFER_ZONE = Rule(
    name=_NAME,
    looks_for="Buffer zones that share no points with lanelets, cross themselves or cover roads",
    codes=(_POINTS, _OUTLINE, _OVERLAP),
    requirements=("vm-06-01",),
    find=_find,
)
