"""Rules on intersections, but for right of way and virtual lights: kept and broken."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import ROAD, MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.intersection.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


class Intersection(MadeMap):
    """An intersection area from x = 20 to 40 between two road borders, and lanes through it."""

    def area(self, *places: tuple[float, float], **tags: str) -> int:
        corners = places or ((20, 7), (20, 0), (40, 0), (40, 7))
        return self.line(*corners, **{"type": "intersection_area", "area": "yes", **tags})

    def through(
        self, x0: float = 20, x1: float = 40, y: float = 0, border: str = "virtual", **tags: str
    ) -> int:
        """Add a lane of 3.5 m along +x."""
        left, right = (
            self.line((x0, side), (x1, side), type=kind)
            for side, kind in ((y + 3.5, "virtual"), (y, border))
        )
        return self.lanelet(left, right, (), None, **{**ROAD, **tags})

    def whole(self, *places: tuple[float, float]) -> int:
        """Add an area with a lane that goes straight on through it."""
        area = self.area(*places)
        self.through(turn_direction="straight", intersection_area=str(area))
        return area


# --- the area itself


def test_an_intersection_with_all_that_belongs_to_it_is_right(tmp_path: Path) -> None:
    made = Intersection()
    made.whole()
    made.line((10, 7), (20, 7), (40, 7), type="road_border")
    for rule in ("validity", "segment_type", "tagging", "dangling_reference"):
        assert found(made, tmp_path, f"intersection_area_{rule}") == []
    for rule in ("turn_direction_tagging", "lanelet_border_type", "lanelet_division"):
        assert found(made, tmp_path, rule) == []


@pytest.mark.parametrize(
    ("places", "said"),
    [
        (((20, 0), (40, 7), (40, 0), (20, 7)), "crosses or touches itself at 30.00, 3.50"),
        (((20, 0), (40, 0), (40, 7), (30, 0), (20, 7)), "crosses or touches itself"),
        (((20, 0), (40, 0)), "has less than three points"),
        (((20, 0), (40, 0), (40, 0)), "has less than three points"),
        (((20, 0), (40, 0), (20, 0), (20, 7)), "crosses or touches itself"),
    ],
)
def test_an_unsound_area(
    tmp_path: Path, places: tuple[tuple[float, float], ...], said: str
) -> None:
    made = Intersection()
    area = made.area(*places)
    made.lane(0, 9, 0, 3.5)
    (issue,) = check_map(made.loaded(tmp_path), ["mapping.intersection.intersection_area_validity"])
    assert issue.primitive_id == area
    assert said in issue.message


@pytest.mark.parametrize("places", [(), ((40, 7), (40, 0), (20, 0), (20, 7), (40, 7))])
def test_an_area_may_be_drawn_either_way_round_and_closed(
    tmp_path: Path, places: tuple[tuple[float, float], ...]
) -> None:
    made = Intersection()
    made.area(*places)
    assert found(made, tmp_path, "intersection_area_validity") == []


def test_points_of_an_area(tmp_path: Path) -> None:
    made = Intersection()
    made.through(10, 20)
    made.line((10, 7), (20, 7), (30, 7), (40, 7), type="road_border")
    made.lane(20, 30, -9, 0, subtype="crosswalk")
    made.line((40, 0), (40, -9), type="stop_line")
    area = made.area((20, 7), (20, 3.5), (20, 0), (30, 0), (40, 0), (40, 7), (30, 7))
    (issue,) = check_map(
        made.loaded(tmp_path), ["mapping.intersection.intersection_area_segment_type"]
    )
    assert issue.primitive_id == area
    ends = made.point(30, 0), made.point(40, 0)  # of a crosswalk, and of a stop line
    assert f"no lanelet's end: {ends[0]}, {ends[1]}." in issue.message


def test_a_lanelet_names_an_area_that_is_not_there(tmp_path: Path) -> None:
    made = Intersection()
    area = made.area()
    other = made.area(type="detection_area")
    made.through(turn_direction="left", intersection_area=str(area))
    gone = made.through(turn_direction="left", intersection_area="999999")
    wrong = made.through(turn_direction="left", intersection_area=str(other))
    made.through(intersection_area="999999")  # no lanelet of an intersection
    expected = [("001", gone), ("001", wrong)]
    assert found(made, tmp_path, "intersection_area_dangling_reference") == expected


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [
        ({}, ["001"]),
        ({"intersection_area": "999"}, ["002"]),
        ({"turn_direction": "left"}, ["001", "004"]),
        ({"subtype": "walkway"}, []),
    ],
)
def test_tags_of_a_lanelet_in_an_area(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    made = Intersection()
    made.area()
    lanelet = made.through(20, 40, 0, "virtual", **tags)
    assert found(made, tmp_path, "intersection_area_tagging") == [(n, lanelet) for n in numbers]


@pytest.mark.parametrize(("x1", "numbers"), [(40.1, []), (45.0, ["003"])])
def test_a_lanelet_that_reaches_out_of_its_area(
    tmp_path: Path, x1: float, numbers: list[str]
) -> None:
    made = Intersection()
    lanelet = made.through(x1=x1, intersection_area=str(made.area()), turn_direction="left")
    assert found(made, tmp_path, "intersection_area_tagging") == [(n, lanelet) for n in numbers]


def test_a_turn_outside_of_all_areas(tmp_path: Path) -> None:
    made = Intersection()
    lanelet = made.through(60, 80, turn_direction="right")
    assert found(made, tmp_path, "intersection_area_tagging") == [("004", lanelet)]


def test_a_lanelet_in_two_areas_may_name_either(tmp_path: Path) -> None:
    made = Intersection()
    made.area()
    second = made.area((19, 8), (19, -1), (41, -1), (41, 8))
    made.through(intersection_area=str(second), turn_direction="straight")
    assert found(made, tmp_path, "intersection_area_tagging") == []


# --- its lanelets


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [({}, ["001"]), ({"turn_direction": "strait"}, ["002"]), ({"turn_direction": "right"}, [])],
)
def test_lanelets_say_where_they_turn(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    made = Intersection()
    made.area()
    lanelet = made.through(20, 40, 0, "virtual", **tags)
    made.through(10, 30)  # not inside
    made.through(y=3.5, subtype="crosswalk")
    assert found(made, tmp_path, "turn_direction_tagging") == [(n, lanelet) for n in numbers]


@pytest.mark.parametrize(
    ("border", "numbers"), [("virtual", []), ("road_border", []), ("line_thin", ["001"])]
)
def test_borders_of_lanelets(tmp_path: Path, border: str, numbers: list[str]) -> None:
    made = Intersection()
    made.through(border="line_thin")  # of no intersection
    lanelet = made.through(border=border, intersection_area="1")
    assert found(made, tmp_path, "lanelet_border_type") == [(n, lanelet) for n in numbers]


@pytest.mark.parametrize(("area_after", "numbers"), [("5", ["001"]), ("6", []), ("", [])])
def test_a_lanelet_in_pieces(tmp_path: Path, area_after: str, numbers: list[str]) -> None:
    made = Intersection()
    first = made.through(20, 30, intersection_area="5")
    after = {"intersection_area": area_after} if area_after else {}
    made.through(30, 40, 0, "virtual", **after)
    made.through(20, 40, y=3.5, intersection_area="5")  # beside it
    assert found(made, tmp_path, "lanelet_division") == [(n, first) for n in numbers]


# --- turn signals


@pytest.mark.parametrize(
    ("turn", "tags", "numbers"),
    [
        ("left", {}, ["001"]),
        ("right", {}, []),
        ("straight", {}, []),
        ("left", {"turn_signal_distance": "9.9"}, []),
        ("left", {"turn_signal_distance": "10"}, ["001"]),
        ("left", {"turn_signal_distance": "0"}, []),
        ("left", {"turn_signal_distance": "far"}, ["001"]),
    ],
)
def test_turns_to_the_other_side_before(
    tmp_path: Path, turn: str, tags: dict[str, str], numbers: list[str]
) -> None:
    made = Intersection()
    made.through(0, 6, turn_direction="right")
    made.through(6, 10)
    lanelet = made.through(10, 20, 0, "virtual", turn_direction=turn, **tags)
    rule = "turn_signal_distance_overlap"
    assert found(made, tmp_path, rule) == [(n, lanelet) for n in numbers]


def test_the_default_distance_is_15_m(tmp_path: Path) -> None:
    made = Intersection()
    made.through(0, 10, turn_direction="right")
    made.through(10, 15.1)
    made.through(15.1, 30, turn_direction="left")
    assert found(made, tmp_path, "turn_signal_distance_overlap") == []


# --- road markings


@pytest.mark.parametrize(
    ("roles", "broken"),
    [
        (["refers"], False),
        ([], True),
        (["ref_line"], True),
        (["refers", "refers"], True),
        (["refers", "ref_line"], True),
    ],
)
def test_members_of_road_markings(tmp_path: Path, roles: list[str], *, broken: bool) -> None:
    made = Intersection()
    made.through()
    lines = [made.line((5, y), (5, y + 3), type="stop_line") for y in range(len(roles))]
    members = [("way", role, line) for role, line in zip(roles, lines, strict=True)]
    rule = made.rule("road_marking", *members)
    assert found(made, tmp_path, "road_markings") == ([("001", rule)] if broken else [])


def test_a_road_marking_of_another_type(tmp_path: Path) -> None:
    made = Intersection()
    line = made.line((5, 0), (5, 3))
    made.rule("road_marking", ("way", "refers", line))
    assert found(made, tmp_path, "road_markings") == [("002", line)]
