"""Rules as a table, what all of them make of hostile maps, and the lookups that they share."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_map import MadeMap
from shapely import Point

from percept.core.errors import UsageError
from percept.hdmap import HdMap
from percept.hdmap.check import NOT_IMPLEMENTED, RULES, check_map
from percept.hdmap.check.checked_map import CheckedMap

MISSING = 999_999


def test_every_rule_has_its_own_name_and_numbers() -> None:
    codes = [code.code for rule in RULES for code in rule.codes]
    codes += [code for rule in NOT_IMPLEMENTED for code in rule.codes]
    assert len({rule.name for rule in RULES}) == len(RULES)
    assert len(set(codes)) == len(codes)
    for rule in RULES:
        assert {code.rule for code in rule.codes} == {rule.name}
        assert len({code.code[:-4] for code in rule.codes}) == 1
        for sentence in (rule.looks_for, *(code.remedy for code in rule.codes)):
            assert not sentence.endswith(".")
            assert sentence[0].isupper()


def test_a_rule_of_no_such_name_is_a_mistake(tmp_path: Path) -> None:
    made = MadeMap()
    made.lane(0, 50, 0, 3.5)
    with pytest.raises(UsageError, match=r"no rule has the name 'mapping\.lane\.x'.*--list-rules"):
        check_map(made.loaded(tmp_path), ["mapping.lane.x"])


def test_only_the_rules_that_are_asked_for_are_held(tmp_path: Path) -> None:
    made = MadeMap()
    lanelet = made.lane(0, 50, 0, 3.5, subtype="road", speed_limit="fast")
    hd_map = made.loaded(tmp_path)
    (issue,) = check_map(hd_map, ["mapping.lane.speed_limit_validity"])
    assert issue.message == (
        f"lanelet {lanelet} has speed_limit='fast', which is no speed. "
        "Write speed_limit as a number of km/h over 0, without a unit."
    )
    assert {i.rule for i in check_map(hd_map)} == {
        "mapping.lane.speed_limit_validity",
        "mapping.lane.road_lanelet_attribute",
    }


def test_issues_come_by_rule_and_by_rising_ids(tmp_path: Path) -> None:
    made = MadeMap()
    for y in (30, 20, 10, 0):
        made.lane(0, 50, y, y + 3.5, subtype="road")
    issues = check_map(made.loaded(tmp_path))
    order = [rule.name for rule in RULES]
    keys = [(order.index(issue.rule), issue.primitive_id) for issue in issues]
    assert len(keys) == 8
    assert keys == sorted(keys)


# ---- maps that no rule may stumble over

_SUBTYPES = (
    "traffic_light", "traffic_sign", "crosswalk", "right_of_way", "virtual_traffic_light",
    "road_marking", "detection_area", "no_stopping_area", "no_parking_area", "bus_stop_area",
    "speed_limit", "",
)  # fmt: skip
_ROLES = ("refers", "ref_line", "yield", "right_of_way", "light_bulbs", "start_line", "end_line")


def without_members(made: MadeMap) -> None:
    """Regulatory elements of every kind with no member, and with members that are not there."""
    for subtype in _SUBTYPES:
        made.rule(subtype)
        made.rule(subtype, *(("way", role, MISSING) for role in _ROLES))
        made.rule(subtype, *(("relation", role, MISSING) for role in _ROLES))
    made.lane(0, 9, 0, 3)


def wrong_members(made: MadeMap) -> None:
    """Regulatory elements whose members are of every kind and in every role."""
    lanelet, point = made.lane(0, 9, 0, 3), made.point(1, 1)
    line = made.line((0, 0), (5, 5))
    for subtype in _SUBTYPES:
        for kind, ref in (("relation", lanelet), ("node", point), ("way", line), ("way", lanelet)):
            made.rule(subtype, *((kind, role, ref) for role in _ROLES))


def cyclic(made: MadeMap) -> None:
    """Regulatory elements that refer to themselves and each other; lanelets in a circle."""
    for subtype in _SUBTYPES:
        own = made.next_id
        made.rule(subtype, *(("relation", role, own) for role in _ROLES))
    corners = [(0, 0), (50, 0), (50, 50), (0, 50), (0, 0)]
    inner = [(5, 5), (45, 5), (45, 45), (5, 45), (5, 5)]
    for step in range(4):
        borders = [made.line(*ring[step : step + 2]) for ring in (inner, corners)]
        made.lanelet(borders[0], borders[1], [MISSING], turn_direction="left", subtype="road")
    ring = [made.line(*places) for places in (inner, corners)]
    made.lanelet(ring[0], ring[1], subtype="road", turn_direction="left")


def crossed(made: MadeMap) -> None:
    """Lanelets whose borders cross, turn back, are one line, or have no length."""
    cross = [made.line((0, 3), (25, -3), (50, 3)), made.line((0, 0), (25, 2), (50, 0))]
    turned = [made.line((0, 3), (50, 3)), made.line((0, 0), (50, 0), (10, 0.5))]
    point = [made.line((70, 0), (70, 0)), made.line((70, 1), (70, 1))]
    flat = [made.line((80, 0), (90, 0)), made.line((80, 0, 1), (90, 0, 1))]
    for subtype in ("road", "crosswalk", "walkway", "road_shoulder", "pedestrian_lane"):
        for left, right in (cross, turned, point, flat, (cross[0], cross[0])):
            made.lanelet(
                left, right, subtype=subtype, turn_direction="right", intersection_area="1"
            )
    for kind in ("intersection_area", "hatched_road_markings", "detection_area", "stop_line"):
        made.line((0, 0), (5, 5), (5, 0), (0, 5), type=kind, area="yes")
        made.line((0, 0), type=kind, area="yes")
        made.line((0, 0), (0, 0), (0, 0), type=kind, area="yes")


def odd_words(made: MadeMap) -> None:
    """Tags with words that are no number, no id and no subtype."""
    for word in ("", "nan", "-1", "1e999", "<b>", "9" * 400, "\u0661\u0662"):
        tags = ("speed_limit", "intersection_area", "turn_direction", "turn_signal_distance")
        made.lane(0, 50, 0, 3, subtype="road", **dict.fromkeys(tags, word))
        made.lane(0, 50, 0, 3, subtype=word)
        made.rule(word)
        made.line((0, 0), (5, 5), type="traffic_light", height=word, traffic_light_id=word)
        made.line((0, 0), (5, 5), type="light_bulbs", traffic_light_id=word)


_HOSTILE = (without_members, wrong_members, cyclic, crossed, odd_words)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_no_rule_stumbles_over_a_hostile_map(hostile: dict[str, HdMap], rule: object) -> None:
    names = [one.name for one in RULES if one is rule]
    for hd_map in hostile.values():
        for issue in check_map(hd_map, names):
            assert str(issue.primitive_id) in issue.message


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> dict[str, HdMap]:
    maps = {}
    for build in _HOSTILE:
        made = MadeMap()
        build(made)
        maps[build.__name__] = made.loaded(tmp_path_factory.mktemp(build.__name__))
    return maps


# ---- lookups


def test_lookups_by_type_and_by_who_refers_to_what(tmp_path: Path) -> None:
    made = MadeMap()
    line = made.line((0, 0), (0, 3), type="stop_line")
    sign = made.line((0, 4), (0, 5), type="traffic_sign")
    rule = made.rule("traffic_sign", ("way", "ref_line", line), ("way", "ref_line", MISSING))
    left, right = made.line((0, 3), (50, 3)), made.line((0, 0), (50, 0))
    lanelet = made.lanelet(left, right, [rule, MISSING, rule])
    checked = CheckedMap(made.loaded(tmp_path))
    (element,) = checked.rules_of("traffic_sign", "right_of_way")
    assert checked.ways_of("traffic_sign", "stop_line") == (line, sign)
    assert checked.ways_in(element, "ref_line") == (line,)
    assert checked.lanelets_in(element, "refers") == ()
    assert [one.rule_id for one in checked.rules_about("way", line)] == [rule]
    assert checked.rules_about("way", sign) == ()
    assert checked.lanelets_under(rule) == (lanelet,)
    assert checked.way_tags(MISSING) == {}
    assert checked.line(MISSING) is None
    assert checked.outline(line) is None
    assert checked.ground(line).is_empty
    assert checked.lanelet_ground(MISSING).is_empty
    assert not checked.is_referred(line, by="traffic_sign")


def test_lookups_by_place(tmp_path: Path) -> None:
    made = MadeMap()
    one, beside = made.lane(0, 50, 0, 3.5), made.lane(0, 50, 3.5, 7)
    across = made.lanelet(made.line((20, 0), (20, 9)), made.line((22, 0), (22, 9)))
    over = made.lanelet(made.line((30, 0, 5), (30, 9, 5)), made.line((32, 0, 5), (32, 9, 5)))
    far = made.lane(100, 150, 0, 3.5)
    checked = CheckedMap(made.loaded(tmp_path))
    assert checked.conflicting(one) == (across,)
    assert checked.conflicting(across) == (one, beside)
    assert checked.conflicting(over) == ()
    assert checked.lanelets_near(Point(99, 1)) == ()
    assert checked.lanelets_near(Point(99, 1), margin_m=1.0) == (far,)
    assert checked.lanelet_ground(one).area == pytest.approx(175.0)
