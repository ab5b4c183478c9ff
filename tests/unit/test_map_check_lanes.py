"""Rules on lanes: each on a map that keeps it and on maps that break it."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import ROAD, MadeMap

from percept.hdmap import load_map
from percept.hdmap.check import check_map

Found = list[tuple[str, int]]


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.lane.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


# --- tags


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [
        ({}, []),
        ({"location": "private"}, []),
        ({"location": "nonurban"}, ["001"]),
        ({"one_way": "no"}, ["002"]),
        ({"location": "", "one_way": ""}, ["001", "002"]),
        ({"subtype": "crosswalk", "location": "", "one_way": "no"}, []),
    ],
)
def test_roads_say_where_they_are_and_are_one_way(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    made = MadeMap()
    lanelet = made.lane(0, 50, 0, 3.5, **{**ROAD, **tags})
    assert found(made, tmp_path, "road_lanelet_attribute") == [(n, lanelet) for n in numbers]


@pytest.mark.parametrize(
    ("speed", "numbers"),
    [
        ("10", []), ("50.0", []), ("9.9", ["002"]), ("51", ["002"]), ("0", ["001"]),
        ("-30", ["001"]), ("30 km/h", ["001"]), ("", ["001"]), ("nan", ["001"]), ("inf", ["001"]),
        ("1e999", ["001"]), ("3_0", ["001"]),
    ],
)  # fmt: skip
def test_speed_limits_are_numbers_in_bounds(tmp_path: Path, speed: str, numbers: list[str]) -> None:
    made = MadeMap()
    lanelet = made.lane(0, 50, 0, 3.5, **{**ROAD, "speed_limit": speed})
    made.lane(0, 50, 10, 13.5, subtype="crosswalk", speed_limit="fast")
    assert found(made, tmp_path, "speed_limit_validity") == [(n, lanelet) for n in numbers]


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [({"lane_change": "yes"}, []), ({}, ["001"]), ({"lane_change": "maybe"}, ["002"])],
)
def test_lines_between_lanes_say_whether_one_may_change(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    made = MadeMap()
    left, right = made.line((0, 7), (50, 7)), made.line((0, 0), (50, 0))
    between = made.line((0, 3.5), (50, 3.5), **tags)
    made.lanelet(left, between)
    made.lanelet(between, right)
    assert found(made, tmp_path, "lane_change_attribute") == [(n, between) for n in numbers]


@pytest.mark.parametrize("subtype", ["road_shoulder", "opposite"])
def test_lines_between_other_lanes_need_not_say_it(tmp_path: Path, subtype: str) -> None:
    made = MadeMap()
    left, right = made.line((0, 7), (50, 7)), made.line((0, 0), (50, 0))
    between = made.line((0, 3.5), (50, 3.5))
    made.lanelet(between, right)
    if subtype == "opposite":
        made.lanelet(between, left)
    else:
        made.lanelet(left, between, subtype=subtype)
    assert found(made, tmp_path, "lane_change_attribute") == []


def test_points_have_local_coordinates_or_none_has(tmp_path: Path) -> None:
    def written(*tags: str) -> Path:
        nodes = [
            f'<node id="{i}" lat="35.{i}" lon="139">'
            + "".join(f'<tag k="local_{axis}" v="{i}"/>' for axis in text)
            + "</node>"
            for i, text in enumerate(tags, start=1)
        ]
        path = tmp_path / "map.osm"
        path.write_text(f"<osm>{''.join(nodes)}</osm>")
        return path

    def numbers(*tags: str) -> Found:
        hd_map = load_map(written(*tags), anywhere=True)
        issues = check_map(hd_map, ["mapping.lane.local_coordinates_declaration"])
        return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]

    assert numbers("xy", "xy") == []
    assert numbers("", "") == []
    assert numbers("xy", "", "x", "y") == [("001", 2), ("002", 3), ("003", 4)]
    assert numbers("", "y") == [("001", 1), ("003", 2)]


# --- shapes


def test_borders_have_no_point_in_common(tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 3.5)
    pointed = made.lanelet(made.line((60, 3), (90, 1)), made.line((60, 0), (90, 1)))
    assert found(made, tmp_path, "lanelet_geometry") == [("001", pointed)]


@pytest.mark.parametrize(
    ("places", "numbers"),
    [
        (((0, 1.75), (25, 1.0), (50, 2.5)), []),
        (((0, 1.75), (25, 3.5), (50, 1.75)), []),  # on the border
        (((1, 1.75), (25, 1.75), (50, 1.75)), ["001"]),
        (((-1, 1.75), (25, 1.75), (51, 1.75)), ["001", "001"]),
        (((0, 1.75), (25, 4.5), (50, 1.75)), ["002"]),
        (((0, 1.75), (25, 4.5), (26, -1), (50, 1.75)), ["002"]),
        (((0, 1.75), (25, 1.75, 0.2), (50, 1.75)), ["003"]),
        (((0, 1.75), (25, 1.75, 0.09), (50, 1.75, 0.11)), ["003"]),
    ],
)
def test_centre_lines_stay_in_their_lanelet(
    tmp_path: Path, places: tuple[tuple[float, ...], ...], numbers: list[str]
) -> None:
    made = MadeMap()
    centre = made.line(*places)
    left, right = made.line((0, 3.5), (50, 3.5)), made.line((0, 0), (50, 0))
    made.lanelet(left, right, (), centre)
    assert found(made, tmp_path, "centerline_geometry") == [(n, centre) for n in numbers]


def test_a_centre_line_may_follow_a_road_that_is_no_plane(tmp_path: Path) -> None:
    profile = [(x, 0.002 * (x - 50.0) ** 2) for x in range(0, 101, 10)]  # a sag of 5 m
    made = MadeMap()
    left, right, centre = (
        made.line(*((x, y, z + 0.05 * y) for x, z in profile)) for y in (3.5, 0.0, 1.75)
    )
    made.lanelet(left, right, (), centre)
    assert found(made, tmp_path, "centerline_geometry") == []


# --- borders


def test_lanes_that_share_a_border_keep_the_rule(tmp_path: Path) -> None:
    made = MadeMap()
    lines = [made.line((0, y), (25, y + 0.5), (50, y)) for y in (0.0, 3.5, 7.0, 10.5)]
    further = [made.line((50, y), (100, y)) for y in (0.0, 3.5, 7.0, 10.5)]
    for right, left in ((0, 1), (1, 2), (3, 2)):  # the last one runs the other way
        made.lanelet(lines[left], lines[right])
        made.lanelet(further[left], further[right])
    assert found(made, tmp_path, "border_sharing") == []


def test_lanes_with_a_line_each_break_it_both(tmp_path: Path) -> None:
    made = MadeMap()
    lower, upper = made.lane(0, 50, 0, 3.5), made.lane(0, 50, 3.6, 7)
    assert found(made, tmp_path, "border_sharing") == [("001", lower), ("001", upper)]


def test_a_gap_of_more_than_a_twentieth_of_the_width_is_a_gap(tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 4)
    made.lane(0, 50, 4.25, 8)
    assert found(made, tmp_path, "border_sharing") == []


def test_a_long_lane_beside_short_ones_is_the_one_to_divide(tmp_path: Path) -> None:
    made = MadeMap()
    long = made.lane(0, 50, 0, 3.5)
    made.lane(0, 25, 3.5001, 7)
    made.lane(25, 50, 3.5001, 7)
    (issue,) = check_map(made.loaded(tmp_path), ["mapping.lane.border_sharing"])
    assert (issue.issue_code, issue.primitive_id) == ("Lane.BorderSharing-002", long)
    assert f"lanelet {long}" in issue.message


def test_two_directions_on_one_lane_and_crossings_are_no_neighbours(tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 3.5)
    made.lanelet(made.line((50, 0.01), (0, 0.01)), made.line((50, 3.49), (0, 3.49)))
    made.lanelet(made.line((20, 0), (20, 3.5)), made.line((22, 0), (22, 3.5)), subtype="crosswalk")
    assert found(made, tmp_path, "border_sharing") == []


# --- what lies beside, and what follows


def test_subtypes_that_follow_each_other(tmp_path: Path) -> None:
    made = MadeMap()
    first = made.lane(0, 50, 0, 3.5)
    second = made.lane(50, 90, 0, 3.5)
    made.lane(90, 99, 0, 3.5, subtype="road_shoulder")
    assert first < second
    assert found(made, tmp_path, "longitudinal_subtype_connection") == [("002", second)]


@pytest.mark.parametrize("turned", [False, True])
def test_crosswalks_are_one_piece(tmp_path: Path, *, turned: bool) -> None:
    made = MadeMap()
    first = made.lane(0, 5, 0, 3, subtype="crosswalk")
    borders = [made.line((5, y), (10, y)) for y in (3, 0)]
    if turned:
        borders = [made.line((10, y), (5, y)) for y in (0, 3)]
    second = made.lanelet(borders[0], borders[1], subtype="crosswalk")
    # People walk both ways: of two ways that meet head-on each is followed by the other.
    expected = [("001", first), ("001", second)] if turned else [("001", first)]
    assert found(made, tmp_path, "longitudinal_subtype_connection") == expected


@pytest.mark.parametrize(
    ("subtype", "broken"),
    [
        ("road", False), ("road_shoulder", False), ("bicycle_lane", False),
        ("pedestrian_lane", False), ("walkway", True), ("crosswalk", True), ("private", False),
    ],
)  # fmt: skip
def test_what_may_lie_beside_a_road(tmp_path: Path, subtype: str, *, broken: bool) -> None:
    made = MadeMap()
    left, between, right = (made.line((0, y), (50, y)) for y in (7, 3.5, 0))
    other = made.lanelet(left, between, subtype=subtype)
    road = made.lanelet(between, right)
    assert other < road
    expected = [("001", road)] if broken else []
    assert found(made, tmp_path, "lateral_subtype_connection") == expected


@pytest.mark.parametrize("rule", ["road_shoulder", "pedestrian_lane"])
def test_shoulders_and_pedestrian_lanes_lie_beside_something(tmp_path: Path, rule: str) -> None:
    made = MadeMap()
    lonely = made.lane(0, 50, 0, 2, subtype=rule)
    assert found(made, tmp_path, rule) == [("001", lonely)]


@pytest.mark.parametrize("rule", ["road_shoulder", "pedestrian_lane"])
@pytest.mark.parametrize(("edge", "numbers"), [("road_border", []), ("line_thin", ["003"])])
def test_their_open_side_is_a_road_border(
    tmp_path: Path, rule: str, edge: str, numbers: list[str]
) -> None:
    made = MadeMap()
    left = made.line((0, 5), (50, 5), type=edge)
    between, right = made.line((0, 3.5), (50, 3.5)), made.line((0, 0), (50, 0))
    made.lanelet(left, between, subtype=rule)
    made.lanelet(between, right)
    assert found(made, tmp_path, rule) == [(n, left) for n in numbers]


def test_a_pedestrian_lane_lies_beside_a_road(tmp_path: Path) -> None:
    made = MadeMap()
    left = made.line((0, 5), (50, 5), type="road_border")
    between, right = made.line((0, 3.5), (50, 3.5)), made.line((0, 0), (50, 0))
    lane = made.lanelet(left, between, subtype="pedestrian_lane")
    made.lanelet(between, right, subtype="road_shoulder")
    assert found(made, tmp_path, "pedestrian_lane") == [("002", lane)]
    assert found(made, tmp_path, "road_shoulder") == [("003", right)]


def test_a_lane_of_the_other_direction_is_no_lane_beside_a_shoulder(tmp_path: Path) -> None:
    made = MadeMap()
    above, between, right = (made.line((0, y), (50, y)) for y in (7, 3.5, 0))
    shoulder = made.lanelet(between, right, subtype="road_shoulder")
    made.lanelet(between, above)  # what lies to the left of its left border heads for -x
    assert found(made, tmp_path, "road_shoulder") == [("001", shoulder)]


def test_of_a_pedestrian_lane_between_two_lanes_nothing_is_said(tmp_path: Path) -> None:
    made = MadeMap()
    lines = [made.line((0, y), (50, y)) for y in (9, 6, 3, 0)]
    for subtype, left, right in zip(
        ("bicycle_lane", "pedestrian_lane", "bicycle_lane"), lines[:-1], lines[1:], strict=True
    ):
        made.lanelet(left, right, subtype=subtype)
    assert found(made, tmp_path, "pedestrian_lane") == []


# --- walkways


@pytest.mark.parametrize(
    ("start", "end", "height", "numbers"),
    [
        (-4.0, 8.0, 0.0, []),
        (-1.0, 8.0, 0.0, ["002"]),
        (1.0, 2.0, 0.0, ["002"]),
        (5.0, 9.0, 0.0, ["001"]),
        (-4.0, 8.0, 6.0, ["001"]),  # a bridge
    ],
)
def test_walkways_cross_a_road_and_reach_beyond_it(
    tmp_path: Path, start: float, end: float, height: float, numbers: list[str]
) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 3.5)
    borders = [made.line((x, start, height), (x, end, height)) for x in (20, 23)]
    walkway = made.lanelet(borders[0], borders[1], subtype="walkway")
    assert found(made, tmp_path, "walkway_intersection") == [(n, walkway) for n in numbers]
