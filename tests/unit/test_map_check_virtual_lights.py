"""Rules on the lines of virtual traffic lights: each kept and broken."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import pytest
from made_map import MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]
DETAILS = "regulatory_element_details_for_virtual_traffic_lights"
ORDER = "virtual_traffic_light_line_order"
OVERLAP = "virtual_traffic_light_section_overlap"


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.intersection.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


class Street(MadeMap):
    """Lanes of 3.5 m along +x that follow each other, and virtual traffic lights on them."""

    def lane_from(self, x0: float, x1: float, *rules: int, y: float = 0) -> int:
        left, right = (self.line((x0, side), (x1, side)) for side in (y + 3.5, y))
        return self.lanelet(left, right, rules)

    def across(self, x: float, kind: str, y: float = 0, *, turned: bool = False) -> int:
        """Add a line across the lane."""
        ends = ((x, y + 3.5), (x, y))
        return self.line(*(ends[::-1] if turned else ends), type=kind)

    def light(
        self,
        start: Sequence[int],
        stop: Sequence[int],
        end: Sequence[int],
        refers: str = "intersection_coordination",
    ) -> int:
        """Add a virtual traffic light of lines; without any refers for an empty type."""
        roles = [("start_line", start), ("ref_line", stop), ("end_line", end)]
        if refers:
            roles.append(("refers", [self.line((30, -5), (31, -5), type=refers)]))
        members = [("way", role, line) for role, lines in roles for line in lines]
        return self.rule("virtual_traffic_light", *members)

    def placed(self, start: float, stop: float, end: float, **turned: bool) -> int:
        """Add a virtual traffic light with lines at x."""
        return self.light(
            [self.across(start, "virtual", **turned)],
            [self.across(stop, "stop_line")],
            [self.across(end, "virtual")],
        )


# --- of what lines they are made


def test_a_light_of_the_right_lines(tmp_path: Path) -> None:
    made = Street()
    made.lane_from(0, 50)
    made.placed(5, 15, 35)
    assert found(made, tmp_path, DETAILS) == []


def test_lines_of_other_types(tmp_path: Path) -> None:
    made = Street()
    lines = [made.across(x, "line_thin") for x in (5, 15, 35)]
    rule = made.light(lines[:1], lines[1:2], lines[2:], refers="elevator")
    expected = [("001", lines[0]), ("003", lines[1]), ("004", lines[2]), ("006", rule - 1)]
    assert found(made, tmp_path, DETAILS) == expected


@pytest.mark.parametrize("count", [0, 2])
def test_a_light_has_one_stop_line(tmp_path: Path, count: int) -> None:
    made = Street()
    stops = [made.across(15 + i, "stop_line") for i in range(count)]
    rule = made.light([made.across(5, "virtual")], stops, [made.across(35, "virtual")])
    assert found(made, tmp_path, DETAILS) == [("002", rule)]


def test_a_light_refers_to_something(tmp_path: Path) -> None:
    made = Street()
    stop = made.across(15, "stop_line")
    rule = made.light([made.across(5, "virtual")], [stop], [], refers="")
    assert found(made, tmp_path, DETAILS) == [("005", rule)]


@pytest.mark.parametrize(("end", "numbers"), [(200.0, []), (206.0, ["007"])])
def test_lines_far_apart(tmp_path: Path, end: float, numbers: list[str]) -> None:
    made = Street()
    rule = made.placed(5, 15, end)
    assert found(made, tmp_path, DETAILS) == [(number, rule) for number in numbers]


# --- in which order they lie


@pytest.mark.parametrize("turned", [False, True])
def test_lines_in_their_order(tmp_path: Path, *, turned: bool) -> None:
    made = Street()
    rule = made.placed(5, 15, 35, turned=turned)
    made.lane_from(0, 10)
    made.lane_from(10, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == []


def test_a_start_line_beside_the_road(tmp_path: Path) -> None:
    made = Street()
    start = made.across(5, "virtual", y=10)
    rule = made.light([start], [made.across(15, "stop_line")], [made.across(35, "virtual")])
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == [("001", start)]


def test_a_lanelet_without_an_end_line(tmp_path: Path) -> None:
    made = Street()
    rule = made.placed(5, 15, 65)
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == [("002", rule)]


def test_a_start_line_on_the_lanelet_of_the_light(tmp_path: Path) -> None:
    made = Street()
    rule = made.placed(25, 30, 35)
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    issues = found(made, tmp_path, ORDER)
    assert [number for number, _ in issues] == ["003"]
    assert issues[0][1] < rule


def test_no_way_from_start_to_end(tmp_path: Path) -> None:
    made = Street()
    rule = made.placed(5, 15, 35)
    made.lane_from(0, 20)
    made.lane_from(22, 40, rule)
    assert found(made, tmp_path, ORDER) == [("004", rule)]


@pytest.mark.parametrize("count", [0, 2])
def test_a_light_has_one_start_line(tmp_path: Path, count: int) -> None:
    made = Street()
    starts = [made.across(5 + i, "virtual") for i in range(count)]
    rule = made.light(starts, [made.across(15, "stop_line")], [made.across(35, "virtual")])
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == [("004", rule)]


def test_a_stop_line_off_the_way_counts_once_for_each_end(tmp_path: Path) -> None:
    made = Street()
    stop = made.across(15, "stop_line", y=10)
    ends = [made.across(35, "virtual"), made.across(35, "virtual", y=-3.5)]
    rule = made.light([made.across(5, "virtual")], [stop], ends)
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    fork = made.line((20, 3.5), (30, 0), (40, 0)), made.line((20, 0), (30, -3.5), (40, -3.5))
    made.lanelet(fork[0], fork[1], [rule])
    assert found(made, tmp_path, ORDER) == [("005", stop)] * 2


@pytest.mark.parametrize(("start", "stop", "end"), [(15, 5, 35), (5, 37, 30), (5, 5, 35)])
def test_lines_in_another_order(tmp_path: Path, start: float, stop: float, end: float) -> None:
    made = Street()
    rule = made.placed(start, stop, end)
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == [("006", rule)]


def test_lights_of_lifts_and_gates_may_have_another_order(tmp_path: Path) -> None:
    made = Street()
    start, stop = made.across(15, "virtual"), made.across(5, "stop_line")
    rule = made.light([start], [stop], [], refers="elevator")
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == []


def test_the_way_is_the_shortest_through_a_circle(tmp_path: Path) -> None:
    made = Street()
    rule = made.placed(5, 15, 35)
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    left = made.line((40, 3.5), (50, 20), (-10, 20), (0, 3.5))
    right = made.line((40, 0), (60, 30), (-20, 30), (0, 0))
    made.lanelet(left, right)
    assert found(made, tmp_path, ORDER) == []


# --- whether one begins before the one before ends


def two_lights(first: tuple[float, ...], second: tuple[float, ...], *knots: float) -> MadeMap:
    """Return a street of lanes between knots with two lights; each is for the lane of its end."""
    made = Street()
    lights = [(made.placed(*places), places[2]) for places in (first, second)]
    for x0, x1 in pairwise(knots):
        made.lane_from(x0, x1, *(rule for rule, end in lights if x0 < end < x1))
    return made


@pytest.mark.parametrize(
    ("first", "second", "knots", "overlaps"),
    [
        ((5, 15, 25), (30, 35, 45), (0, 20, 40, 60), 0),  # they share the lane from 20 to 40
        ((5, 15, 32), (28, 35, 45), (0, 20, 40, 60), 2),
        ((5, 15, 25), (45, 55, 65), (0, 20, 40, 60, 80), 0),  # they share no lane
        ((5, 15, 55), (28, 55, 65), (0, 20, 40, 60, 80), 2),  # they share two
        ((5, 15, 65), (28, 35, 45), (0, 20, 40, 60, 80), 2),  # one lies in the other
        ((5, 15, 45), (8, 18, 48), (0, 20, 40, 60), 2),  # both have one way
    ],
)
def test_sections_that_overlap(
    tmp_path: Path,
    first: tuple[float, ...],
    second: tuple[float, ...],
    knots: tuple[float, ...],
    overlaps: int,
) -> None:
    issues = found(two_lights(first, second, *knots), tmp_path, OVERLAP)
    assert len(issues) == overlaps
    assert len({rule for _, rule in issues}) == overlaps
    assert {number for number, _ in issues} <= {"001"}


def test_sections_that_part_are_not_compared(tmp_path: Path) -> None:
    made = Street()
    straight = made.placed(5, 15, 35)
    stop = made.across(15, "stop_line")
    bend = made.light([made.across(5, "virtual")], [stop], [made.across(35, "virtual", y=-3.5)])
    made.lane_from(0, 20)
    made.lane_from(20, 40, straight)
    fork = made.line((20, 3.5), (30, 0), (40, 0)), made.line((20, 0), (30, -3.5), (40, -3.5))
    made.lanelet(fork[0], fork[1], [bend])
    assert found(made, tmp_path, OVERLAP) == []


@pytest.mark.parametrize("lacking", ["start", "end"])
def test_a_light_that_lacks_a_line_overlaps_nothing(tmp_path: Path, lacking: str) -> None:
    made = Street()
    start, stop, end = made.across(5, "virtual"), made.across(15, "stop_line"), None
    if lacking == "start":
        end = made.across(35, "virtual")
    broken = made.light([start] if end is None else [], [stop], [] if end is None else [end])
    whole = made.placed(35, 45, 55)
    made.lane_from(0, 20)
    made.lane_from(20, 40, broken)
    made.lane_from(40, 60, whole)
    assert found(made, tmp_path, OVERLAP) == []


def test_a_light_without_a_stop_line_has_no_order(tmp_path: Path) -> None:
    made = Street()
    rule = made.light([made.across(5, "virtual")], [], [made.across(35, "virtual")])
    made.lane_from(0, 20)
    made.lane_from(20, 40, rule)
    assert found(made, tmp_path, ORDER) == []
