"""Lanelets, areas, rules and markings of Lanelet2 files, and what is left out of broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_osm import lanelet, node, relation, way, write_osm

from percept.hdmap import HdMap, MapMarking, load_map

NODES = "".join(node(10 * row + k, 10.0 * k, 3.0 * row) for row in range(3) for k in range(6))
LOW, MIDDLE, HIGH = ([10 * row + k for k in range(6)] for row in range(3))


def read(folder: Path, *elements: str) -> HdMap:
    return load_map(write_osm(folder / "map.osm", NODES, *elements))


def marking(street: HdMap, identity: int) -> MapMarking:
    (found,) = (m for m in street.markings if m.element_id == identity)
    return found


@pytest.mark.parametrize("left", [MIDDLE, MIDDLE[::-1]])
@pytest.mark.parametrize("right", [LOW, LOW[::-1]])
def test_borders_run_as_they_are_driven(tmp_path: Path, left: list[int], right: list[int]) -> None:
    street = read(tmp_path, way(1, left), way(2, right), lanelet(5, [1], [2], location="urban"))
    lane = street.lanelets[5]
    assert lane.left_nodes == tuple(MIDDLE)
    assert lane.right_nodes == tuple(LOW)
    np.testing.assert_array_equal(lane.left_map[:, 0], np.arange(0.0, 60.0, 10.0))
    np.testing.assert_array_equal(lane.right_map[0], [0, 0, 0])
    assert (lane.subtype, lane.tags["location"], lane.centreline_id) == ("road", "urban", 0)


def test_the_right_border_is_the_one_that_the_map_calls_right(tmp_path: Path) -> None:
    street = read(tmp_path, way(1, LOW), way(2, MIDDLE), lanelet(5, [1], [2]))
    assert street.lanelets[5].left_nodes == tuple(LOW[::-1])
    assert street.lanelets[5].right_nodes == tuple(MIDDLE[::-1])


def test_a_border_of_several_line_strings_is_joined_in_any_order(tmp_path: Path) -> None:
    parts = (way(1, MIDDLE[2:0:-1]), way(2, MIDDLE[:2]), way(3, MIDDLE[2:]), way(4, LOW))
    lane = read(tmp_path, *parts, lanelet(5, [1, 3, 2], [4])).lanelets[5]
    assert lane.left_ids == (2, 1, 3)
    assert lane.left_nodes == tuple(MIDDLE)
    np.testing.assert_array_equal(lane.left_map[:, 0], np.arange(0.0, 60.0, 10.0))


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (lanelet(5, [1], []), "without a whole left and right border"),
        (lanelet(5, [99], [2]), "without a whole left and right border"),
        (lanelet(5, [3], [2]), "without a whole left and right border"),
        (lanelet(5, [4], [2]), "without a whole left and right border"),
        (lanelet(5, [1, 2], [2]), "whose line strings do not join"),
        (relation(5, [("way", "outer", 1)], type="multipolygon"), "areas without a closed outline"),
        (relation(5, [("way", "outer", 99)], type="multipolygon"), "without a closed outline"),
    ],
)
def test_broken_relations_are_counted_and_the_rest_is_read(
    tmp_path: Path, broken: str, reason: str
) -> None:
    lines = (way(1, MIDDLE), way(2, LOW), way(3, [0, 77]), way(4, [1]))
    street = read(tmp_path, *lines, broken, lanelet(6, [1], [2]))
    assert set(street.lanelets) == {6}
    assert not street.areas
    assert [count for key, count in street.dropped.items() if reason in key] == [1]


def test_a_lanelet_that_crosses_itself_is_read(tmp_path: Path) -> None:
    bow = [MIDDLE[0], LOW[2], MIDDLE[4]]
    other = [LOW[0], MIDDLE[2], LOW[4]]
    lane = read(tmp_path, way(1, bow), way(2, other), lanelet(5, [1], [2])).lanelets[5]
    assert {lane.left_nodes, lane.left_nodes[::-1]} == {tuple(bow), tuple(bow[::-1])}
    assert len(lane.right_map) == 3


def test_areas_are_joined_to_a_ring(tmp_path: Path) -> None:
    edges = (way(1, [LOW[0], LOW[1], MIDDLE[1]]), way(2, [LOW[0], MIDDLE[0], MIDDLE[1]]))
    area = relation(
        5,
        [("way", "outer", 1), ("way", "outer", 2), ("relation", "regulatory_element", 8)],
        type="multipolygon",
        subtype="parking",
    )
    found = read(tmp_path, *edges, area).areas[5]
    assert found.outer_map.shape == (4, 3)
    assert {tuple(p[:2]) for p in found.outer_map.tolist()} == {(0, 0), (10, 0), (10, 3), (0, 3)}
    assert (found.outer_ids, found.rule_ids, found.inner_ids) == ((1, 2), (8,), ())


def test_rules_keep_all_their_members(tmp_path: Path) -> None:
    rule = relation(
        8,
        [("way", "refers", 1), ("way", "ref_line", 2), ("relation", "refers", 99)],
        type="regulatory_element",
        subtype="right_of_way",
    )
    found = read(tmp_path, way(1, LOW), way(2, MIDDLE), rule).rules[8]
    assert found.subtype == "right_of_way"
    assert (found.ids("refers"), found.ids("refers", "way"), found.ids("x")) == ((1, 99), (1,), ())
    assert {role: len(there) for role, there in found.by_role.items()} == {
        "refers": 2,
        "ref_line": 1,
    }


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"type": "line_thin", "subtype": "dashed"}, ("line", "dashed", "white", True)),
        (
            {"type": "line_thick", "subtype": "solid_dashed", "color": "yellow"},
            ("line", "solid_dashed", "yellow", True),
        ),
        ({"type": "line_thin", "color": "blue"}, ("line", "unknown", "blue", True)),
        ({"type": "line_thin", "color": ""}, ("line", "unknown", "unknown", True)),
        ({"type": "line_thin", "subtype": "wavy"}, ("line", "unknown", "white", True)),
        ({"type": "virtual", "subtype": "solid"}, ("line", "unknown", "unknown", False)),
        ({"type": "curbstone", "subtype": "high"}, ("line", "unknown", "unknown", False)),
        ({"type": "road_border", "color": "white"}, ("line", "unknown", "unknown", False)),
        ({"type": "guard_rail"}, ("line", "unknown", "unknown", False)),
        ({"type": "pedestrian_marking"}, ("crosswalk", "unknown", "white", True)),
        ({"type": "stop_line", "subtype": "solid"}, ("stop_line", "solid", "white", True)),
        ({"type": "stop_line", "subtype": "virtual"}, ("stop_line", "unknown", "white", False)),
    ],
)
def test_what_a_line_string_stands_for(
    tmp_path: Path, tags: dict[str, str], expected: tuple[str, str, str, bool]
) -> None:
    street = read(tmp_path, way(1, LOW, **tags))
    found = marking(street, 1)
    assert (found.kind, found.type, found.colour, found.painted) == expected
    assert (found.name, street.dropped.total()) == ("way 1", 0)
    np.testing.assert_array_equal(found.points_map, street.points_of(1))


@pytest.mark.parametrize(
    ("text", "width"), [("0.15", 0.15), ("wide", np.nan), ("inf", np.nan), ("-1", np.nan)]
)
def test_widths(tmp_path: Path, text: str, width: float) -> None:
    street = read(tmp_path, way(1, LOW, type="line_thin", width=text))
    np.testing.assert_equal(marking(street, 1).width_m, width)


def test_types_that_are_not_known_are_counted_and_symbols_are_no_lines(tmp_path: Path) -> None:
    lines = (
        way(1, LOW, type="ufo_track"),
        way(2, MIDDLE),
        way(3, HIGH, type="arrow"),
        way(4, HIGH[:2], type="traffic_sign"),
    )
    street = read(tmp_path, *lines, lanelet(5, [2], [1]))
    assert sorted(street.dropped.values()) == [1, 1]
    assert any("'ufo_track'" in key for key in street.dropped)
    assert any("without a type" in key for key in street.dropped)
    # As borders both are lines, of which nothing is known.
    assert [(m.element_id, m.painted) for m in street.markings] == [(1, False), (2, False)]


def test_the_line_of_a_rule_about_stopping_is_a_stop_line(tmp_path: Path) -> None:
    def rule(identity: int, subtype: str, line: int, **tags: str) -> str:
        members = [("way", "ref_line", line), ("way", "refers", 9)]
        return relation(identity, members, type="regulatory_element", subtype=subtype, **tags)

    lines = [way(k, LOW, type="line_thin", subtype="solid") for k in (1, 2, 3)]
    signs = way(9, HIGH[:2], type="traffic_sign", subtype="stop_sign")
    rules = (rule(21, "traffic_light", 1), rule(22, "speed_limit", 2), rule(23, "traffic_sign", 3))
    street = read(tmp_path, *lines, signs, *rules)
    assert [m.kind for m in street.markings] == ["stop_line", "line", "stop_line"]
    limit = signs.replace("stop_sign", "de274")
    street = read(tmp_path, *lines, limit, *rules)
    assert [m.kind for m in street.markings] == ["stop_line", "line", "line"]


def test_lines_that_bound_only_a_crosswalk_belong_to_it(tmp_path: Path) -> None:
    lines = [way(k, ids, type="line_thin") for k, ids in ((1, LOW), (2, MIDDLE), (3, HIGH))]
    crossing = lanelet(5, [2], [1], subtype="crosswalk")
    street = read(tmp_path, *lines, crossing, lanelet(6, [3], [2]))
    assert [m.kind for m in street.markings] == ["crosswalk", "line", "line"]


def test_values_of_tags_are_as_they_were_written(tmp_path: Path) -> None:
    name = "<script>alert('&')</script>"
    street = read(tmp_path, way(1, LOW, type="line_thin", name=name))
    assert street.line_strings[1].tags["name"] == name
