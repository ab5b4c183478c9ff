"""The rule that walkways cross roads, and begin and end well off them."""

from __future__ import annotations

from collections.abc import Iterator

import shapely

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.elements import Lanelet

__all__ = ["WALKWAY_INTERSECTION"]

_NAME = "mapping.lane.walkway_intersection"
_NO_ROAD = IssueCode(
    "Lane.WalkwayIntersection-001", _NAME, "Error", "lanelet",
    "Draw walkways where people cross a road, and remove others",
)  # fmt: skip
_LEAST_BEYOND_M = 3.0
_SHORT = IssueCode(
    "Lane.WalkwayIntersection-002", _NAME, "Error", "lanelet",
    f"Let both ends lie {_LEAST_BEYOND_M:g} m or more off the road",
)  # fmt: skip


def _walkway_intersection(checked: CheckedMap) -> Iterator[MapIssue]:
    lanelets = checked.hd_map.lanelets
    for walkway in checked.lanelets_of("walkway"):
        crossed = [
            other
            for other in checked.conflicting(walkway.lanelet_id)
            if lanelets[other].subtype in ("road", "private")
        ]
        if not crossed:
            yield _NO_ROAD.at(walkway.lanelet_id, "is a walkway that crosses no road")
        for road_id in crossed:
            beyond_m = _beyond_m(checked, walkway, road_id)
            if beyond_m < _LEAST_BEYOND_M:
                yield _SHORT.at(
                    walkway.lanelet_id,
                    f"is a walkway that ends {beyond_m:.2f} m from where it crosses road {road_id}",
                )


def _beyond_m(checked: CheckedMap, walkway: Lanelet, road_id: int) -> float:
    """Return how far off a road the nearer end of a walkway is, beside their common ground."""
    ground = checked.lanelet_ground(walkway.lanelet_id)
    common = ground.intersection(checked.lanelet_ground(road_id))
    ends = (
        shapely.LineString([walkway.left_map[row, :2], walkway.right_map[row, :2]])
        for row in (0, -1)
    )
    return min(float(common.distance(end)) for end in ends)


WALKWAY_INTERSECTION = Rule(
    name=_NAME,
    looks_for="Walkways that cross no road, or that end close to the road that they cross",
    codes=(_NO_ROAD, _SHORT),
    find=_walkway_intersection,
)
