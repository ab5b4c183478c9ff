"""Rules on right of way: under traffic lights, without any, and under virtual ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from made_map import ROAD, MadeMap

from percept.hdmap.check import check_map

Found = list[tuple[str, int]]
WITH, WITHOUT, VIRTUAL = (
    "with_traffic_lights",
    "without_traffic_lights",
    "for_virtual_traffic_lights",
)


def found(made: MadeMap, folder: Path, rule: str) -> Found:
    """Return the last three digits of the numbers found, each with its primitive."""
    issues = check_map(made.loaded(folder), [f"mapping.intersection.right_of_way_{rule}"])
    return [(issue.issue_code[-3:], issue.primitive_id) for issue in issues]


class Crossing(MadeMap):
    """Lanes that cross each other; who crosses is a matter of ground, not of what they are."""

    def across(self, x: float, z: float = 0.0, rules: Sequence[int] = (), **tags: str) -> int:
        """Add a lane of 3 m along +y, from y = -20 to 20."""
        left, right = (self.line((side, -20, z), (side, 20, z)) for side in (x, x + 3))
        return self.lanelet(left, right, rules, None, **{**ROAD, **tags})

    def along(self, rules: Sequence[int] = (), x0: float = 0, x1: float = 60, **tags: str) -> int:
        """Add a lane of 3.5 m along +x."""
        left, right = (self.line((x0, y), (x1, y)) for y in (3.5, 0))
        return self.lanelet(left, right, rules, None, **{**ROAD, **tags})

    def signal(self, degrees: float) -> int:
        """Add a regulatory element about a light whose line runs in a direction."""
        angle = math.radians(degrees)
        ends = (70.0, 0.0, 5.0), (70 + math.cos(angle), math.sin(angle), 5.0)
        light = self.line(*ends, type="traffic_light")
        return self.rule("traffic_light", ("way", "refers", light))

    def virtual_light(self) -> int:
        return self.rule("virtual_traffic_light")

    def right_of_way(self, *yields: int, owners: Sequence[int] = (), own: bool = True) -> int:
        """Add a right of way, of the lanelet that is added next if that is to own it.

        That one stands seven elements on: two lines of two new points each come between.
        """
        members = [("relation", "right_of_way", owner) for owner in owners]
        if own:
            members.append(("relation", "right_of_way", self.next_id + 7))
        members += [("relation", "yield", other) for other in yields]
        return self.rule("right_of_way", *members)


# --- whom a lanelet without lights yields to


def test_all_that_crosses_is_yielded_to(tmp_path: Path) -> None:
    made = Crossing()
    others = [made.across(10), made.across(20), made.across(30, subtype="crosswalk")]
    rule = made.right_of_way(*others[:2])
    made.along([rule], turn_direction="left")
    assert found(made, tmp_path, WITHOUT) == []


def test_what_crosses_and_is_not_yielded_to(tmp_path: Path) -> None:
    made = Crossing()
    first, second = made.across(10), made.across(20)
    rule = made.right_of_way(first)
    lanelet = made.along([rule], turn_direction="straight")
    issues = check_map(
        made.loaded(tmp_path), ["mapping.intersection.right_of_way_without_traffic_lights"]
    )
    assert [(i.issue_code[-3:], i.primitive_id) for i in issues] == [("003", rule)]
    assert f"lets lanelet {lanelet} not yield to lanelet {second}" in issues[0].message


@pytest.mark.parametrize("other", ["far", "bridge", "beside", "before"])
def test_what_does_not_cross_need_not_be_yielded_to(tmp_path: Path, other: str) -> None:
    made = Crossing()
    if other == "far":
        lanelet = made.across(100)
    elif other == "bridge":
        lanelet = made.across(10, z=6.0)
    elif other == "before":
        lanelet = made.along(x0=-60, x1=0)
    else:
        left, right = made.line((0, 7), (60, 7)), made.line((0, 3.5), (60, 3.5))
        lanelet = made.lanelet(left, right)
    borders = made.line((0, 3.5), (60, 3.5)), made.line((0, 0), (60, 0))
    rule = made.rule(
        "right_of_way",
        ("relation", "right_of_way", made.next_id + 1),
        ("relation", "yield", lanelet),
    )
    made.lanelet(borders[0], borders[1], [rule], None, **ROAD, turn_direction="left")
    assert found(made, tmp_path, WITHOUT) == [("004", rule)]


def diverging(made: Crossing, kind: str, *signals: int) -> tuple[int, int]:
    """Add two lanes from one lane before them; return the second and its right of way."""
    made.along(x0=-30, x1=0)
    made.lanelet(made.line((0, 3.5), (60, 20)), made.line((0, 0), (60, 16.5)), signals)
    borders = made.line((0, 3.5), (60, 3.5)), made.line((0, 0), (60, 0))
    rule = made.rule("right_of_way", ("relation", "right_of_way", made.next_id + 1))
    rules = [rule, *signals]
    return made.lanelet(borders[0], borders[1], rules, None, **ROAD, turn_direction=kind), rule


def test_lanes_from_one_lane_do_not_yield_to_each_other(tmp_path: Path) -> None:
    made = Crossing()
    diverging(made, "left")
    assert found(made, tmp_path, WITHOUT) == []
    made = Crossing()
    diverging(made, "left", made.signal(0))
    assert found(made, tmp_path, WITH) == []


def test_virtual_lights_are_asked_for_against_lanes_from_one_lane_too(tmp_path: Path) -> None:
    made = Crossing()
    _, rule = diverging(made, "left", made.virtual_light())
    (missing,) = found(made, tmp_path, VIRTUAL)[-1:]
    assert missing == ("005", rule)


@pytest.mark.parametrize(("is_yield", "numbers"), [(True, []), (False, ["006"])])
def test_a_lane_that_is_hardly_touched_may_be_yielded_to(
    tmp_path: Path, numbers: list[str], *, is_yield: bool
) -> None:
    made = Crossing()
    touched = made.lanelet(made.line((30, 20), (30, 3.4)), made.line((27, 20), (27, 3.4)))
    rule = made.right_of_way(*([touched] if is_yield else []))
    made.along([rule], turn_direction="left")
    assert found(made, tmp_path, WITHOUT) == [(number, rule) for number in numbers]


@pytest.mark.parametrize(("count", "number"), [(0, "001"), (2, "001"), (1, "002")])
def test_the_owner_of_a_right_of_way(tmp_path: Path, count: int, number: str) -> None:
    made = Crossing()
    other = made.across(10)
    rule = made.right_of_way(other, owners=[other] * (count > 0), own=count == 2)
    made.along([rule], turn_direction="left")
    assert found(made, tmp_path, WITHOUT) == [(number, rule)]


@pytest.mark.parametrize("light", ["traffic_light", "virtual_traffic_light"])
def test_lanes_with_lights_are_not_those_without(tmp_path: Path, light: str) -> None:
    made = Crossing()
    made.across(10)
    rule = made.right_of_way(own=False)
    made.along([rule, made.rule(light)], turn_direction="left")
    assert found(made, tmp_path, WITHOUT) == []


def test_an_intersection_without_any_right_of_way(tmp_path: Path) -> None:
    made = Crossing()
    corners = ((0, 0), (60, 0), (60, 9), (0, 9))
    bare, ruled, unused = (
        made.line(*corners, type="intersection_area", area="yes") for _ in range(3)
    )
    made.along(intersection_area=str(bare))
    made.across(10, intersection_area=str(bare))
    made.along(intersection_area=str(ruled))
    made.across(10, rules=[made.rule("right_of_way"), made.signal(0)], intersection_area=str(ruled))
    made.along(intersection_area="999999")
    assert unused
    assert found(made, tmp_path, WITHOUT) == [("005", bare)]


# --- turns under traffic lights


@pytest.mark.parametrize(
    ("turn", "numbers"), [("left", ["001"]), ("right", ["001"]), ("straight", [])]
)
def test_turns_under_lights_need_a_right_of_way(
    tmp_path: Path, turn: str, numbers: list[str]
) -> None:
    made = Crossing()
    lanelet = made.along([made.signal(0)], turn_direction=turn)
    assert found(made, tmp_path, WITH) == [(number, lanelet) for number in numbers]


def test_turns_under_lights_need_no_second_right_of_way(tmp_path: Path) -> None:
    made = Crossing()
    rules = [made.rule("right_of_way"), made.rule("right_of_way"), made.signal(0)]
    lanelet = made.along(rules, turn_direction="left")
    assert found(made, tmp_path, WITH) == [("002", lanelet)]


def test_turns_under_lights_need_their_own_right_of_way(tmp_path: Path) -> None:
    made = Crossing()
    rule = made.right_of_way(own=False, owners=[made.across(10)])
    made.along([rule, made.signal(0)], turn_direction="left")
    assert found(made, tmp_path, WITH) == [("003", rule)]


@pytest.mark.parametrize(
    ("turn", "other_turn", "other_light", "yields"),
    [
        ("left", "straight", 90.0, True),  # another phase
        ("left", "straight", 180.0, False),  # the opposite light of the same phase
        ("left", "straight", 40.0, False),
        ("left", "straight", 50.0, True),
        ("left", "straight", None, True),  # no light at all
        ("left", "right", 180.0, True),
        ("right", "left", 180.0, False),
        ("right", "straight", 90.0, True),
    ],
)
@pytest.mark.parametrize("is_yield", [False, True])
def test_whom_turns_under_lights_yield_to(
    tmp_path: Path,
    turn: str,
    other_turn: str,
    other_light: float | None,
    *,
    yields: bool,
    is_yield: bool,
) -> None:
    made = Crossing()
    lights = [] if other_light is None else [made.signal(other_light)]
    other = made.across(10, rules=lights, turn_direction=other_turn)
    own = made.signal(0)
    rule = made.right_of_way(*([other] if is_yield else []))
    made.along([rule, own], turn_direction=turn)
    expected = [] if yields == is_yield else [("004" if yields else "005", rule)]
    issues = found(made, tmp_path, WITH)
    assert [issue for issue in issues if issue[1] == rule] == expected


def test_a_turn_under_lights_that_hardly_touches_another_lane(tmp_path: Path) -> None:
    made = Crossing()
    made.lanelet(made.line((30, 20), (30, 3.4)), made.line((27, 20), (27, 3.4)))
    own = made.signal(0)
    rule = made.right_of_way()
    made.along([rule, own], turn_direction="left")
    assert found(made, tmp_path, WITH) == [("006", rule)]


# --- virtual traffic lights


def test_lanes_under_virtual_lights_need_one_right_of_way(tmp_path: Path) -> None:
    made = Crossing()
    none = made.along([made.virtual_light()])
    many = made.along([made.rule("right_of_way"), made.rule("right_of_way"), made.virtual_light()])
    assert found(made, tmp_path, VIRTUAL) == [("001", none), ("002", many)]


@pytest.mark.parametrize(("count", "number"), [(0, "003"), (2, "003"), (1, "004")])
def test_the_owner_of_a_right_of_way_under_a_virtual_light(
    tmp_path: Path, count: int, number: str
) -> None:
    made = Crossing()
    other, light = made.across(10), made.virtual_light()
    rule = made.right_of_way(other, owners=[other] * (count > 0), own=count == 2)
    made.along([rule, light])
    assert found(made, tmp_path, VIRTUAL) == [(number, rule)]


def test_whom_lanes_under_virtual_lights_yield_to(tmp_path: Path) -> None:
    made = Crossing()
    made.across(10)
    made.lanelet(made.line((30, 20), (30, 3.4)), made.line((27, 20), (27, 3.4)))
    far, light = made.across(100), made.virtual_light()
    rule = made.right_of_way(far)
    made.along([rule, light])
    assert found(made, tmp_path, VIRTUAL) == [("005", rule), ("007", rule), ("006", rule)]
