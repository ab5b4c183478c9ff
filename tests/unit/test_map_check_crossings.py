"""Rules on stop lines and crosswalks: each on a map that keeps it and on maps that break it."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import ROAD, MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]
CROSSWALK = {"subtype": "crosswalk", "participant:pedestrian": "yes"}
MISSING = 999_999


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


# --- stop lines


@pytest.mark.parametrize("role", ["ref_line", "refers", None])
def test_something_refers_to_a_stop_line(tmp_path: Path, role: str | None) -> None:
    made = MadeMap()
    line = made.line((0, 0), (0, 3.5), type="stop_line")
    other = made.line((9, 0), (9, 3.5))
    made.rule("road_marking", ("way", role or "refers", other if role is None else line))
    expected = [("001", line)] if role is None else []
    assert found(made, tmp_path, "stop_line.missing_regulatory_elements") == expected


SIGN = {"type": "traffic_sign", "subtype": "stop_sign"}
LINE = {"type": "stop_line", "subtype": "stop_line"}


@pytest.mark.parametrize(
    ("sign", "line", "far", "expected"),
    [
        (SIGN, LINE, 5.0, []),
        (SIGN, LINE, 250.0, [("005", "rule")]),
        (None, LINE, 5.0, [("001", "rule")]),
        (SIGN, None, 5.0, [("003", "rule")]),
        ({**SIGN, "type": "wall"}, LINE, 5.0, [("002", "sign")]),
        ({**SIGN, "subtype": "yield"}, LINE, 5.0, [("002", "sign")]),
        (SIGN, {**LINE, "subtype": "solid"}, 5.0, [("004", "line")]),
    ],
)
def test_a_stop_sign_has_a_sign_and_a_line(
    tmp_path: Path,
    sign: dict[str, str] | None,
    line: dict[str, str] | None,
    far: float,
    expected: list[tuple[str, str]],
) -> None:
    made = MadeMap()
    ids = {
        "sign": made.line((far, 0), (far, 1), **(sign or SIGN)),
        "line": made.line((0, 0), (0, 3.5), **(line or LINE)),
    }
    ids["rule"] = made.rule(
        "traffic_sign",
        ("way", "refers", MISSING if sign is None else ids["sign"]),
        ("way", "ref_line", MISSING if line is None else ids["line"]),
    )
    rule = "stop_line.regulatory_element_details_for_traffic_signs"
    assert found(made, tmp_path, rule) == [(number, ids[name]) for number, name in expected]


# --- crosswalks


class Crossing:
    """A road, a crosswalk over it, a stop line, and the regulatory element between the three."""

    def __init__(self, road_from_x: float = 0.0, /, **tags: str) -> None:
        self.made = made = MadeMap()
        borders = [made.line((x, -2), (x, 6)) for x in (20, 23)]
        self.crosswalk = made.lanelet(borders[0], borders[1], (), None, **{**CROSSWALK, **tags})
        self.line = made.line((18, 0), (18, 3.5), type="stop_line")
        self.members = [("relation", "refers", self.crosswalk), ("way", "ref_line", self.line)]
        self.road_from_x = road_from_x

    def found(self, folder: Path, rule: str = "regulatory_element_details") -> Found:
        self.rule = self.made.rule("crosswalk", *self.members)
        self.road = self.made.line((self.road_from_x, 3.5), (self.road_from_x + 50, 3.5))
        other = self.made.line((self.road_from_x, 0), (self.road_from_x + 50, 0))
        self.made.lanelet(self.road, other, [self.rule], None, **ROAD)
        return found(self.made, folder, f"crosswalk.{rule}")


def test_a_whole_crossing_keeps_all_rules(tmp_path: Path) -> None:
    crossing = Crossing(safety_slow_down_speed="15.5", safety_slow_down_distance="20")
    assert crossing.found(tmp_path) == []
    assert found(crossing.made, tmp_path, "crosswalk.missing_regulatory_elements") == []
    assert found(crossing.made, tmp_path, "crosswalk.safety_attributes") == []


def test_a_crosswalk_without_a_regulatory_element(tmp_path: Path) -> None:
    crossing = Crossing()
    other = crossing.made.lane(100, 105, 0, 3, **CROSSWALK)
    crossing.made.rule("right_of_way", ("relation", "yield", other))
    assert crossing.found(tmp_path, "missing_regulatory_elements") == [("001", other)]


@pytest.mark.parametrize("ref", [None, MISSING])
def test_a_regulatory_element_without_a_crosswalk(tmp_path: Path, ref: int | None) -> None:
    crossing = Crossing()
    crossing.members[:1] = [] if ref is None else [("relation", "refers", ref)]
    issues = crossing.found(tmp_path)
    assert issues == [("001", crossing.rule)]


def test_a_regulatory_element_with_two_crosswalks(tmp_path: Path) -> None:
    crossing = Crossing()
    borders = [crossing.made.line((x, -2), (x, 6)) for x in (30, 33)]
    other = crossing.made.lanelet(borders[0], borders[1], (), None, **CROSSWALK)
    crossing.members.append(("relation", "refers", other))
    issues = crossing.found(tmp_path)
    assert issues == [("002", crossing.rule)]


def test_a_regulatory_element_with_no_or_two_stop_lines(tmp_path: Path) -> None:
    bare, double = Crossing(), Crossing()
    bare.members.pop()
    double.members.append(double.members[-1])
    issues = bare.found(tmp_path)
    assert issues == [("003", bare.rule)]
    issues = double.found(tmp_path)
    assert issues == [("009", double.rule)]


@pytest.mark.parametrize(
    ("tags", "number"),
    [
        ({"subtype": "walkway"}, "006"),
        ({"participant:pedestrian": "no"}, "011"),
        ({"participant:pedestrian": ""}, "011"),
        ({"participant:pedestrian": "true"}, None),
    ],
)
def test_the_tags_of_the_crosswalk(
    tmp_path: Path, tags: dict[str, str], number: str | None
) -> None:
    crossing = Crossing(0.0, **tags)
    expected = [] if number is None else [(number, crossing.crosswalk)]
    assert crossing.found(tmp_path) == expected


def test_a_crosswalk_for_nobody(tmp_path: Path) -> None:
    made = MadeMap()
    lanelet = made.lane(0, 5, 0, 3, subtype="crosswalk")
    line = made.line((9, 0), (9, 3), type="stop_line")
    made.rule("crosswalk", ("relation", "refers", lanelet), ("way", "ref_line", line))
    assert found(made, tmp_path, "crosswalk.regulatory_element_details") == [("010", lanelet)]


def test_a_stop_line_of_another_type(tmp_path: Path) -> None:
    crossing = Crossing()
    other = crossing.made.line((19, 0), (19, 3.5))
    crossing.members[1] = ("way", "ref_line", other)
    assert crossing.found(tmp_path) == [("007", other)]


def test_a_road_that_the_crosswalk_does_not_cross(tmp_path: Path) -> None:
    crossing = Crossing(60.0)
    issues = crossing.found(tmp_path)
    assert issues == [("012", crossing.rule)]


def test_members_far_apart(tmp_path: Path) -> None:
    crossing = Crossing()
    far = crossing.made.line((300, 0), (300, 3.5), type="stop_line")
    crossing.members[1] = ("way", "ref_line", far)
    issues = crossing.found(tmp_path)
    assert issues == [("013", crossing.rule)]


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [
        ({}, []),
        ({"safety_slow_down_speed": "0"}, ["001"]),
        ({"safety_slow_down_speed": "5 km/h", "safety_slow_down_distance": "-1"}, ["001", "002"]),
        ({"safety_slow_down_distance": "inf"}, ["002"]),
        ({"safety_slow_down_distance": ".5e1"}, []),
    ],
)
def test_speeds_and_distances_to_slow_down(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    crossing = Crossing(0.0, **tags)
    expected = [(number, crossing.crosswalk) for number in numbers]
    assert crossing.found(tmp_path, "safety_attributes") == expected
