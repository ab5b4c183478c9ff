"""Rules on areas: each on a map that keeps it and on maps that break it."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import ROAD, MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]
SQUARE = ((10.0, 0.0), (20.0, 0.0), (20.0, 3.5), (10.0, 3.5))


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.area.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


def area(made: MadeMap, kind: str, **tags: str) -> int:
    return made.line(*SQUARE, **{"type": kind, "area": "yes", **tags})


# --- areas that a regulatory element gives a meaning

KINDS = ("detection_area", "no_stopping_area", "no_parking_area")
UNUSED = {"detection_area": "005", "no_stopping_area": "006", "no_parking_area": "004"}
FOREIGN = {"detection_area": "006", "no_stopping_area": "007", "no_parking_area": "005"}


def ruled(
    made: MadeMap, kind: str, *refers: int, lines: int = 1, line_type: str = "stop_line"
) -> int:
    """Add a regulatory element about polygons, with stop lines but for those of no parking."""
    count = 0 if kind == "no_parking_area" else lines
    stops = [made.line((9, y), (9, y + 3), type=line_type) for y in range(count)]
    members = [("way", "refers", polygon) for polygon in refers]
    return made.rule(kind, *members, *(("way", "ref_line", stop) for stop in stops))


@pytest.mark.parametrize("kind", KINDS)
def test_an_area_that_road_lanelets_obey_is_right(tmp_path: Path, kind: str) -> None:
    made = MadeMap()
    rule = ruled(made, kind, area(made, kind))
    for x in (0, 30):
        made.lanelet(made.line((x, 3.5), (x + 30, 3.5)), made.line((x, 0), (x + 30, 0)), [rule])
    assert found(made, tmp_path, kind) == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("referred_by", ["", "no_such_area"])
def test_an_area_needs_a_regulatory_element_of_its_kind(
    tmp_path: Path, kind: str, referred_by: str
) -> None:
    made = MadeMap()
    polygon = area(made, kind)
    if referred_by:
        made.rule(referred_by, ("way", "refers", polygon))
    made.rule(kind, ("way", "ref_line", polygon))
    assert ("001", polygon) in found(made, tmp_path, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_only_what_says_area_is_a_polygon(tmp_path: Path, kind: str) -> None:
    made = MadeMap()
    rule = ruled(made, kind, area(made, kind, area="no"))
    made.lanelet(made.line((0, 3.5), (30, 3.5)), made.line((0, 0), (30, 0)), [rule])
    assert found(made, tmp_path, kind) == [("002", rule)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_regulatory_element_is_about_one_polygon_of_its_kind(tmp_path: Path, kind: str) -> None:
    made = MadeMap()
    own, other = area(made, kind), area(made, "bus_stop_area")
    two, wrong, none = ruled(made, kind, own, other), ruled(made, kind, other), ruled(made, kind)
    lines = made.line((0, 3.5), (30, 3.5)), made.line((0, 0), (30, 0))
    made.lanelet(*lines, [two, wrong, none])
    assert found(made, tmp_path, kind) == [("002", two), ("003", wrong), ("002", none)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_regulatory_element_holds_for_roads_only(tmp_path: Path, kind: str) -> None:
    made = MadeMap()
    polygon = area(made, kind)
    unused, mixed = ruled(made, kind, polygon), ruled(made, kind, polygon)
    lines = made.line((0, 3.5), (30, 3.5)), made.line((0, 0), (30, 0))
    made.lanelet(*lines, [mixed])
    made.lanelet(*lines, [mixed], subtype="road_shoulder")
    assert found(made, tmp_path, kind) == [(UNUSED[kind], unused), (FOREIGN[kind], mixed)]


@pytest.mark.parametrize(
    ("kind", "lines", "line_type", "numbers"),
    [
        ("detection_area", 0, "stop_line", ["004"]),
        ("detection_area", 2, "stop_line", ["004"]),
        ("detection_area", 1, "virtual", ["004"]),
        ("no_stopping_area", 0, "stop_line", []),
        ("no_stopping_area", 2, "stop_line", ["004"]),
        ("no_stopping_area", 1, "virtual", ["005"]),
    ],
)
def test_stop_lines_of_areas(
    tmp_path: Path, kind: str, lines: int, line_type: str, numbers: list[str]
) -> None:
    made = MadeMap()
    rule = ruled(made, kind, area(made, kind), lines=lines, line_type=line_type)
    made.lanelet(made.line((0, 3.5), (30, 3.5)), made.line((0, 0), (30, 0)), [rule])
    assert found(made, tmp_path, kind) == [(number, rule) for number in numbers]


def test_bus_stops_need_a_regulatory_element(tmp_path: Path) -> None:
    made = MadeMap()
    referred, alone = area(made, "bus_stop_area"), area(made, "bus_stop_area")
    made.rule("bus_stop_area", ("way", "refers", referred))
    made.lane(0, 50, 0, 3.5)
    rule = "missing_regulatory_elements_for_bus_stop_areas"
    assert found(made, tmp_path, rule) == [("001", alone)]


# --- buffer zones

ZONE = ((10.0, 0.0), (20.0, 0.0), (20.0, 3.0), (10.0, 3.0))


def between_lanes(*zone: tuple[float, float], subtype: str = "road") -> tuple[MadeMap, int, int]:
    """Return a map with a zone between two lanes, the zone, and the lane below it."""
    made = MadeMap()
    above = made.line((0, 3), (10, 3), (20, 3), (50, 3)), made.line((0, 6.5), (50, 6.5))
    below = made.line((0, 0), (10, 0), (20, 0), (50, 0)), made.line((0, -3.5), (50, -3.5))
    made.lanelet(above[1], above[0])
    lane = made.lanelet(below[0], below[1], (), None, **{**ROAD, "subtype": subtype})
    return made, made.line(*zone, type="hatched_road_markings", area="yes"), lane


def test_a_zone_of_points_of_the_lanes_beside_it_is_right(tmp_path: Path) -> None:
    made, _, _ = between_lanes(*ZONE)
    assert found(made, tmp_path, "buffer_zone_validity") == []


def test_a_zone_with_points_of_its_own_is_reported_once(tmp_path: Path) -> None:
    made, zone, _ = between_lanes((10, 0), (15, 0.5), (16, 0.5), (20, 0), (20, 3), (10, 3))
    (issue,) = check_map(made.loaded(tmp_path), ["mapping.area.buffer_zone_validity"])
    assert (issue.issue_code[-3:], issue.primitive_id) == ("001", zone)
    points = made.point(15, 0.5), made.point(16, 0.5)
    assert f"no lanelet beside it has: {points[0]}, {points[1]}." in issue.message


def test_a_zone_that_crosses_itself_covers_nothing_that_could_be_said(tmp_path: Path) -> None:
    made, zone, _ = between_lanes(ZONE[0], ZONE[2], ZONE[1], ZONE[3])
    assert found(made, tmp_path, "buffer_zone_validity") == [("002", zone)]


@pytest.mark.parametrize(
    ("subtype", "numbers"), [("road", ["003"]), ("road_shoulder", ["003"]), ("walkway", [])]
)
def test_a_zone_on_a_road_is_reported(tmp_path: Path, subtype: str, numbers: list[str]) -> None:
    made, zone, lane = between_lanes((0, -3.5), (50, -3.5), *ZONE[2:], subtype=subtype)
    issues = check_map(made.loaded(tmp_path), ["mapping.area.buffer_zone_validity"])
    assert [(i.issue_code[-3:], i.primitive_id) for i in issues] == [(n, zone) for n in numbers]
    assert all(f"lanelet {lane}" in issue.message for issue in issues)


def test_a_sliver_on_a_road_is_none(tmp_path: Path) -> None:
    made = MadeMap()
    made.lanelet(made.line((0, 0.02), (50, 0.02)), made.line((0, -3.5), (50, -3.5)))
    made.line(*ZONE, type="hatched_road_markings", area="yes")
    assert [number for number, _ in found(made, tmp_path, "buffer_zone_validity")] == ["001"]
