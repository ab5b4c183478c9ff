"""Rules on traffic lights: each on a map that keeps it and on maps that break it."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.traffic_light.{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


class Crossing(MadeMap):
    """A lane along +x with a stop line before its end, and lights beyond that face it."""

    def light(self, y: float = 0.0, x: float = 60.0, **tags: str) -> int:
        """Add a light; whoever drives along +x sees it from left to right."""
        kind = {"type": "traffic_light", "subtype": "red_yellow_green", "height": "0.5"}
        return self.line((x, y + 1, 5), (x, y, 5), **{**kind, **tags})

    def bulbs(self, light: int, **tags: str) -> int:
        kind = {"type": "light_bulbs", "traffic_light_id": str(light)}
        return self.line((60, 0.8, 5.2), (60, 0.5, 5.2), (60, 0.2, 5.2), **{**kind, **tags})

    def stop_line(self, x: float = 48.0, **tags: str) -> int:
        return self.line((x, 3.5), (x, 0), **{"type": "stop_line", **tags})

    def about(self, lights: list[int], bulbs: list[int], stops: list[int]) -> int:
        """Add a regulatory element about lights."""
        roles = (("refers", lights), ("light_bulbs", bulbs), ("ref_line", stops))
        members = [("way", role, way) for role, ways in roles for way in ways]
        return self.rule("traffic_light", *members)

    def lane_under(self, *rules: int, **tags: str) -> int:
        left, right = self.line((0, 3.5), (50, 3.5)), self.line((0, 0), (50, 0))
        return self.lanelet(left, right, list(rules), None, **tags)


def test_a_light_with_all_that_belongs_to_it_is_right(tmp_path: Path) -> None:
    made = Crossing()
    light = made.light()
    bulbs = made.line(
        *((60.0, y, 5.2) for y in (0.8, 0.5)), type="light_bulbs", traffic_light_id=str(light)
    )
    made.lane_under(made.about([light], [bulbs], [made.stop_line()]))
    for rule in ("missing_referrers", "missing_regulatory_elements", "regulatory_element_details"):
        assert found(made, tmp_path, rule) == []
    for rule in ("correct_facing", "body_height"):
        assert found(made, tmp_path, rule) == []


@pytest.mark.parametrize(
    ("height", "numbers"),
    [
        ("0.2", []),
        ("2.0", []),
        ("0.19", ["002"]),
        ("45", ["002"]),
        ("high", ["002"]),
        ("", ["002"]),
    ],
)
def test_heights_of_lights(tmp_path: Path, height: str, numbers: list[str]) -> None:
    made = Crossing()
    light = made.light(height=height)
    assert found(made, tmp_path, "body_height") == [(number, light) for number in numbers]


def test_a_light_without_a_height(tmp_path: Path) -> None:
    made = Crossing()
    light = made.line((60, 1, 5), (60, 0, 5), type="traffic_light")
    made.line((60, 1, 5), (60, 0, 5), type="traffic_sign")
    assert found(made, tmp_path, "body_height") == [("001", light)]


@pytest.mark.parametrize(
    ("tags", "numbers"),
    [
        ({"color": "red"}, []),
        ({"color": "green", "arrow": "up_left"}, []),
        ({}, ["001"]),
        ({"color": "amber"}, ["002"]),
        ({"color": "green", "arrow": "down"}, ["003"]),
        ({"arrow": "down_right"}, ["001", "003"]),
    ],
)
def test_bulbs_have_a_colour_and_may_be_arrows(
    tmp_path: Path, tags: dict[str, str], numbers: list[str]
) -> None:
    made = MadeMap()
    bulb = made.point(60, 0.5, 5.2, **tags)
    other = made.point(60, 0.2, 5.2, color="red")
    line = made.line((60, 0.5, 5.2), (60, 0.2, 5.2), type="light_bulbs")
    for _ in range(2):  # two regulatory elements, one report
        made.rule("traffic_light", ("way", "light_bulbs", line))
    made.line((60, 7, 5), (60, 8, 5), type="light_bulbs")
    assert other != bulb
    assert found(made, tmp_path, "light_bulb_tagging") == [(number, bulb) for number in numbers]


def test_a_regulatory_element_needs_lanelets(tmp_path: Path) -> None:
    made = Crossing()
    used, unused = made.about([], [], []), made.about([], [], [])
    made.lane_under(used)
    assert found(made, tmp_path, "missing_referrers") == [("001", unused)]


def test_a_light_needs_a_regulatory_element_of_its_kind(tmp_path: Path) -> None:
    made = Crossing()
    used, alone, foreign = made.light(), made.light(2), made.light(4)
    made.about([used], [], [])
    made.rule("crosswalk", ("way", "refers", foreign))
    expected = [("001", alone), ("001", foreign)]
    assert found(made, tmp_path, "missing_regulatory_elements") == expected


# --- members of regulatory elements


@pytest.mark.parametrize(
    ("subtype", "of_lanelet", "numbers"),
    [
        ("red_yellow_green", "road", ["001"]),
        ("red_green", "road", []),
        ("red_yellow_green", "crosswalk", []),
    ],
)
def test_lights_for_vehicles_need_a_stop_line(
    tmp_path: Path, subtype: str, of_lanelet: str, numbers: list[str]
) -> None:
    made = Crossing()
    light = made.light(subtype=subtype)
    rule = made.about([light], [made.bulbs(light)], [])
    made.lane_under(rule, subtype=of_lanelet)
    assert found(made, tmp_path, "regulatory_element_details") == [(n, rule) for n in numbers]


def test_members_of_other_types(tmp_path: Path) -> None:
    made = Crossing()
    light = made.light(type="traffic_sign")
    bulbs = made.bulbs(light, type="virtual")
    stop = made.stop_line(type="virtual")
    made.lane_under(made.about([light], [bulbs], [stop]))
    expected = [("002", light), ("004", bulbs), ("003", stop)]
    assert found(made, tmp_path, "regulatory_element_details") == expected


def test_bulbs_that_name_no_light(tmp_path: Path) -> None:
    made = Crossing()
    light = made.light()
    bulbs = made.line((60, 0.8, 5.2), (60, 0.5, 5.2), type="light_bulbs")
    rule = made.about([light], [bulbs], [made.stop_line()])
    made.lane_under(rule)
    expected = sorted([("005", bulbs), ("007", rule)], key=lambda pair: pair[1])
    assert found(made, tmp_path, "regulatory_element_details") == expected


def test_more_lights_than_bulbs(tmp_path: Path) -> None:
    made = Crossing()
    lights = [made.light(), made.light(2)]
    rule = made.about(lights, [made.bulbs(lights[0])], [made.stop_line()])
    made.lane_under(rule)
    assert found(made, tmp_path, "regulatory_element_details") == [("006", rule)]


def test_bulbs_of_one_light_twice(tmp_path: Path) -> None:
    made = Crossing()
    lights = [made.light(), made.light(2)]
    bulbs = [made.bulbs(lights[0]), made.bulbs(lights[0])]
    rule = made.about(lights, bulbs, [made.stop_line()])
    made.lane_under(rule)
    assert found(made, tmp_path, "regulatory_element_details") == [("007", rule)]


@pytest.mark.parametrize(("x", "numbers"), [(240.0, []), (260.0, ["008"])])
def test_members_far_apart(tmp_path: Path, x: float, numbers: list[str]) -> None:
    made = Crossing()
    lights = [made.light(), made.light(x=x)]
    rule = made.about(lights, [made.bulbs(light) for light in lights], [made.stop_line()])
    made.lane_under(rule)
    assert found(made, tmp_path, "regulatory_element_details") == [(n, rule) for n in numbers]


# --- which way they face


def turned(made: Crossing, **tags: str) -> int:
    """Add a light that whoever drives along +x sees from right to left."""
    kind = {"type": "traffic_light", "subtype": "red_yellow_green"}
    return made.line((60, 0, 5), (60, 1, 5), **{**kind, **tags})


def test_a_light_that_is_drawn_the_wrong_way(tmp_path: Path) -> None:
    made = Crossing()
    right, wrong, people = made.light(), turned(made), turned(made, subtype="red_green")
    made.lane_under(made.about([right, wrong, people], [], [made.stop_line()]))
    assert found(made, tmp_path, "correct_facing") == [("002", wrong)]


def test_a_closed_outline_faces_nowhere(tmp_path: Path) -> None:
    made = Crossing()
    corners = ((60, 0, 5), (60, 1, 5), (60, 1, 6), (60, 0, 5))
    light = made.line(*corners, type="traffic_light", subtype="red_yellow_green")
    made.lane_under(made.about([light], [], [made.stop_line()]))
    assert found(made, tmp_path, "correct_facing") == []


@pytest.mark.parametrize("without", ["stop line", "lanelet"])
def test_nothing_is_said_of_a_light_that_nobody_is_known_to_see(
    tmp_path: Path, without: str
) -> None:
    made = Crossing()
    light, stop = turned(made), made.stop_line()
    rule = made.about([light], [], [] if without == "stop line" else [stop])
    made.lane_under(*([] if without == "lanelet" else [rule]))
    assert found(made, tmp_path, "correct_facing") == []


def test_a_light_of_both_directions(tmp_path: Path) -> None:
    made = Crossing()
    light = made.light()
    made.lane_under(made.about([light], [], [made.stop_line()]))
    assert found(made, tmp_path, "correct_facing") == []
    back = made.line((120, 4), (80, 4)), made.line((120, 8), (80, 8))  # driven along -x
    beyond = made.line((82, 4), (82, 8), type="stop_line")
    made.lanelet(back[0], back[1], [made.about([light], [], [beyond])])
    assert found(made, tmp_path, "correct_facing") == [("003", light)]


def test_lanelets_that_begin_at_an_angle(tmp_path: Path) -> None:
    made = Crossing()
    light = made.light()
    rule = made.about([light], [], [made.stop_line(50.0)])
    made.lane_under(rule)
    across = made.line((50, -20), (50, 0)), made.line((53.5, -20), (53.5, 0))
    made.lanelet(across[0], across[1], [rule])
    assert found(made, tmp_path, "correct_facing") == [("001", light)]
