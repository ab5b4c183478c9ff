"""The polygon of an intersection: how it is drawn, and that it and its lanelets name each other."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.area import flaw_of, polygons_of
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.participants import may_pass

__all__ = [
    "DANGLING_REFERENCE",
    "INTERSECTION_AREA_SEGMENTS",
    "INTERSECTION_AREA_TAGGING",
    "INTERSECTION_AREA_VALIDITY",
    "areas_covering",
]

_KIND = "intersection_area"
_TAG = "intersection_area"
_COVERED_SHARE = 0.99
"""Share of a lanelet by area from which on it counts as inside: borders are drawn by hand."""


def areas_covering(checked: CheckedMap) -> dict[int, tuple[int, ...]]:
    """Return by road lanelet the intersection areas that it lies in, ids rising."""
    inside: dict[int, tuple[int, ...]] = {}
    for area in polygons_of(checked, _KIND):
        for lanelet in checked.lanelets_near(checked.ground(area)):
            if checked.hd_map.lanelets[lanelet].subtype == "road" and _covers(
                checked, area, lanelet
            ):
                inside[lanelet] = (*inside.get(lanelet, ()), area)
    return inside


def _covers(checked: CheckedMap, area: int, lanelet: int) -> bool:
    ground = checked.lanelet_ground(lanelet)
    shared = ground.intersection(checked.ground(area)).area
    return bool(ground.area > 0 and shared >= _COVERED_SHARE * ground.area)


_DANGLING = "mapping.intersection.intersection_area_dangling_reference"
_NO_AREA = IssueCode(
    "Intersection.IntersectionAreaDanglingReference-001",
    _DANGLING,
    "Error",
    "lanelet",
    "Set the tag intersection_area to the id of the polygon it lies in, or remove the tag",
)


def _find_dangling(checked: CheckedMap) -> Iterator[MapIssue]:
    areas = {str(area) for area in polygons_of(checked, _KIND)}
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        named = lanelet.tags.get(_TAG)
        if "turn_direction" in lanelet.tags and named is not None and named not in areas:
            yield _NO_AREA.at(lanelet_id, f"names intersection area {named}, which is not there")


DANGLING_REFERENCE = Rule(
    name=_DANGLING,
    looks_for="Lanelets of intersections that name an area which is not there",
    codes=(_NO_AREA,),
    requirements=("vm-03-01",),
    find=_find_dangling,
)

_SEGMENTS = "mapping.intersection.intersection_area_segment_type"
_FOREIGN_POINTS = IssueCode(
    "Intersection.IntersectionAreaSegmentType-001",
    _SEGMENTS,
    "Error",
    "polygon",
    "Draw it by points of road_border lines and of the ends of lanelets only",
)


def _find_foreign_points(checked: CheckedMap) -> Iterator[MapIssue]:
    ways = checked.hd_map.line_strings
    allowed = {node for border in checked.ways_of("road_border") for node in ways[border].nodes}
    for lanelet in checked.hd_map.lanelets.values():
        if may_pass(lanelet.tags, "vehicle"):
            for border in (lanelet.left_nodes, lanelet.right_nodes):
                allowed.update((border[0], border[-1]))
    for area in polygons_of(checked, _KIND):
        foreign = [node for node in ways[area].nodes if node not in allowed]
        if foreign:
            points = ", ".join(map(str, dict.fromkeys(foreign)))
            what = f"has points of no road border and no lanelet's end: {points}"
            yield _FOREIGN_POINTS.at(area, what)


INTERSECTION_AREA_SEGMENTS = Rule(
    name=_SEGMENTS,
    looks_for="Intersection areas with points of no road border and no lanelet's end",
    codes=(_FOREIGN_POINTS,),
    requirements=("vm-03-08",),
    find=_find_foreign_points,
)

_VALIDITY = "mapping.intersection.intersection_area_validity"
_UNSOUND = IssueCode(
    "Intersection.IntersectionAreaValidity-001",
    _VALIDITY,
    "Error",
    "polygon",
    "Draw it as one closed line that does not cross itself",
)


def _find_unsound(checked: CheckedMap) -> Iterator[MapIssue]:
    for area in polygons_of(checked, _KIND):
        flaw = flaw_of(checked, area)
        if flaw is not None:
            yield _UNSOUND.at(area, flaw)


INTERSECTION_AREA_VALIDITY = Rule(
    name=_VALIDITY,
    looks_for="Intersection areas that cross themselves or have too few points",
    codes=(_UNSOUND,),
    requirements=("vm-03-08",),
    find=_find_unsound,
)

_TAGGING = "mapping.intersection.intersection_area_tagging"
_SET_TAG = "Set its tag intersection_area to the id of the polygon that it lies in"
_NO_TAG = IssueCode(
    "Intersection.IntersectionAreaTagging-001", _TAGGING, "Error", "lanelet", _SET_TAG
)
_OTHER_TAG = IssueCode(
    "Intersection.IntersectionAreaTagging-002", _TAGGING, "Error", "lanelet", _SET_TAG
)
_NOT_INSIDE = IssueCode(
    "Intersection.IntersectionAreaTagging-003",
    _TAGGING,
    "Error",
    "lanelet",
    "Draw the polygon so that the lanelet lies in it, or remove the tag",
)
_TURN_WITHOUT_TAG = IssueCode(
    "Intersection.IntersectionAreaTagging-004", _TAGGING, "Error", "lanelet", _SET_TAG
)


def _find_tagging(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, areas in areas_covering(checked).items():
        named, inside = checked.hd_map.lanelets[lanelet_id].tags.get(_TAG), areas[0]
        if named is None:
            yield _NO_TAG.at(lanelet_id, f"lies in intersection area {inside}, but names none")
        elif named not in map(str, areas):
            what = f"lies in intersection area {inside}, but names {named}"
            yield _OTHER_TAG.at(lanelet_id, what)
    by_name = {str(area): area for area in polygons_of(checked, _KIND)}
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        named, turn = lanelet.tags.get(_TAG), lanelet.tags.get("turn_direction")
        if named is None:
            if turn:
                what = f"turns ({turn!r}), but names no intersection area"
                yield _TURN_WITHOUT_TAG.at(lanelet_id, what)
        elif named in by_name and not _covers(checked, by_name[named], lanelet_id):
            what = f"names intersection area {named}, but lies not all in it"
            yield _NOT_INSIDE.at(lanelet_id, what)


INTERSECTION_AREA_TAGGING = Rule(
    name=_TAGGING,
    looks_for="Lanelets that lie in one intersection area and name another or none",
    codes=(_NO_TAG, _OTHER_TAG, _NOT_INSIDE, _TURN_WITHOUT_TAG),
    requirements=("vm-03-01",),
    find=_find_tagging,
)
