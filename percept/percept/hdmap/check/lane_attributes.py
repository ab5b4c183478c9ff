"""Rules on the tags of lanelets, of the lines between them, and of points."""

from __future__ import annotations

from collections.abc import Iterator

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.tag_numbers import number_in
from percept.hdmap.elements import Lanelet

__all__ = [
    "LANE_CHANGE_ATTRIBUTE",
    "LOCAL_COORDINATES_DECLARATION",
    "ROAD_LANELET_ATTRIBUTE",
    "SPEED_LIMIT_VALIDITY",
]

_LOWEST_SPEED_LIMIT_KMPH = 10.0
_HIGHEST_SPEED_LIMIT_KMPH = 50.0

_ROAD = "mapping.lane.road_lanelet_attribute"
_NO_LOCATION = IssueCode(
    "Lane.RoadLaneletAttribute-001", _ROAD, "Error", "lanelet",
    "Set its tag location to urban or private",
)  # fmt: skip
_NOT_ONE_WAY = IssueCode(
    "Lane.RoadLaneletAttribute-002", _ROAD, "Error", "lanelet",
    "Set its tag one_way to yes, and draw a lanelet for each direction",
)  # fmt: skip

_SPEED = "mapping.lane.speed_limit_validity"
_NO_SPEED = IssueCode(
    "Lane.SpeedLimitValidity-001", _SPEED, "Error", "lanelet",
    "Write speed_limit as a number of km/h over 0, without a unit",
)  # fmt: skip
_FAR_SPEED = IssueCode(
    "Lane.SpeedLimitValidity-002", _SPEED, "Error", "lanelet",
    f"Write a speed_limit of {_LOWEST_SPEED_LIMIT_KMPH:g} to {_HIGHEST_SPEED_LIMIT_KMPH:g} km/h",
)  # fmt: skip

_CHANGE = "mapping.lane.lane_change_attribute"
_NO_CHANGE = IssueCode(
    "Lane.LaneChangeAttribute-001", _CHANGE, "Error", "linestring",
    "Set its tag lane_change to yes or no",
)  # fmt: skip
_WRONG_CHANGE = IssueCode(
    "Lane.LaneChangeAttribute-002", _CHANGE, "Error", "linestring",
    "Set its tag lane_change to yes or no",
)  # fmt: skip

_LOCAL = "mapping.lane.local_coordinates_declaration"
_NO_LOCAL = IssueCode(
    "Lane.LocalCoordinatesDeclaration-001", _LOCAL, "Error", "point",
    "Give every point local_x and local_y, or none",
)  # fmt: skip
_NO_LOCAL_Y = IssueCode(
    "Lane.LocalCoordinatesDeclaration-002", _LOCAL, "Error", "point",
    "Give it local_y too",
)  # fmt: skip
_NO_LOCAL_X = IssueCode(
    "Lane.LocalCoordinatesDeclaration-003", _LOCAL, "Error", "point",
    "Give it local_x too",
)  # fmt: skip


def _road_lanelet_attribute(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet in checked.lanelets_of("road"):
        if lanelet.tags.get("location") not in ("urban", "private"):
            yield _NO_LOCATION.at(lanelet.lanelet_id, f"{_said(lanelet, 'location')} on a road")
        if lanelet.tags.get("one_way") != "yes":
            yield _NOT_ONE_WAY.at(lanelet.lanelet_id, f"{_said(lanelet, 'one_way')} on a road")


def _said(lanelet: Lanelet, key: str) -> str:
    word = lanelet.tags.get(key)
    return f"has no {key}" if word is None else f"has {key}='{word}'"


def _speed_limit_validity(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet in checked.lanelets_of("road", "private"):
        word = lanelet.tags.get("speed_limit")
        if word is None:
            continue
        speed_kmph = number_in(word)
        if speed_kmph is None or speed_kmph <= 0:
            yield _NO_SPEED.at(lanelet.lanelet_id, f"has speed_limit='{word}', which is no speed")
        elif not _LOWEST_SPEED_LIMIT_KMPH <= speed_kmph <= _HIGHEST_SPEED_LIMIT_KMPH:
            yield _FAR_SPEED.at(
                lanelet.lanelet_id, f"has speed_limit='{word}', which is out of bounds"
            )


def _lane_change_attribute(checked: CheckedMap) -> Iterator[MapIssue]:
    """Look at lines between two roads of one direction: left border of one, right of the other."""
    roads = {lanelet.lanelet_id for lanelet in checked.lanelets_of("road")}
    between: dict[int, tuple[int, int]] = {}
    for lanelet_id in sorted(roads):
        for beside in checked.routing.left[lanelet_id]:
            if not beside.opposite and beside.lanelet_id in roads:
                between.setdefault(beside.border_id, (lanelet_id, beside.lanelet_id))
    for border_id, (right, left) in between.items():
        word = checked.way_tags(border_id).get("lane_change")
        where = f"between the roads {right} and {left} of one direction"
        if word is None:
            yield _NO_CHANGE.at(border_id, f"{where} has no lane_change")
        elif word not in ("yes", "no"):
            yield _WRONG_CHANGE.at(border_id, f"{where} has lane_change='{word}'")


def _local_coordinates_declaration(checked: CheckedMap) -> Iterator[MapIssue]:
    points = checked.hd_map.point_tags
    if not any("local_x" in tags or "local_y" in tags for tags in points.values()):
        return
    for point_id, tags in points.items():
        has_x, has_y = "local_x" in tags, "local_y" in tags
        if not has_x and not has_y:
            yield _NO_LOCAL.at(point_id, "has no local_x and local_y, as other points have")
        elif not has_y:
            yield _NO_LOCAL_Y.at(point_id, "has local_x and no local_y")
        elif not has_x:
            yield _NO_LOCAL_X.at(point_id, "has local_y and no local_x")


ROAD_LANELET_ATTRIBUTE = Rule(
    name=_ROAD,
    looks_for="Roads that are not said to be urban or private, or not to be one-way",
    codes=(_NO_LOCATION, _NOT_ONE_WAY),
    requirements=("vm-01-01",),
    find=_road_lanelet_attribute,
)
SPEED_LIMIT_VALIDITY = Rule(
    name=_SPEED,
    looks_for="Speed limits of roads that are no number over 0, or out of bounds",
    codes=(_NO_SPEED, _FAR_SPEED),
    find=_speed_limit_validity,
)
LANE_CHANGE_ATTRIBUTE = Rule(
    name=_CHANGE,
    looks_for="Lines between two roads of one direction that do not say whether one may change",
    codes=(_NO_CHANGE, _WRONG_CHANGE),
    requirements=("vm-01-02",),
    find=_lane_change_attribute,
)
LOCAL_COORDINATES_DECLARATION = Rule(
    name=_LOCAL,
    looks_for="Points without local coordinates in a map that has them, or with one of the two",
    codes=(_NO_LOCAL, _NO_LOCAL_Y, _NO_LOCAL_X),
    find=_local_coordinates_declaration,
)
