"""Which lanelets follow, which lie beside each other, and who may use them."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_osm import lanelet, node, way, write_osm

from percept.hdmap import load_map
from percept.hdmap.routing import Neighbour, Passage, RoutingGraph, make_routing

# Three rows of lanes side by side, each of two lanelets one behind the other.
NODES = "".join(node(10 * row + k, 10.0 * k, 3.0 * row) for row in range(4) for k in range(3))
DASHED = {"type": "line_thin", "subtype": "dashed"}


def street(
    folder: Path, middle: dict[str, str], participant: str | None, **tags: str
) -> RoutingGraph:
    """Lanelets 51, 52 below 61, 62 below 71, 72; `middle` is between the first two rows."""
    lines = [
        way(
            10 * row + part,
            [10 * row + part, 10 * row + part + 1],
            **(middle if row == 1 else DASHED),
        )
        for row in range(4)
        for part in (0, 1)
    ]
    lanes = [
        lanelet(51 + 10 * row + part, [10 * row + 10 + part], [10 * row + part], **tags)
        for row in range(3)
        for part in (0, 1)
    ]
    found = load_map(write_osm(folder / "map.osm", NODES, *lines, *lanes))
    assert set(found.lanelets) == {51, 52, 61, 62, 71, 72}
    return make_routing(found.lanelets, found.line_strings, participant)


def test_lanelets_follow_where_both_borders_meet(tmp_path: Path) -> None:
    graph = street(tmp_path, DASHED, "vehicle")
    assert graph.following_ids(51) == (52,)
    assert graph.previous_ids(52) == (51,)
    assert graph.following_ids(52) == graph.previous_ids(51) == ()
    assert graph.following_ids(999) == ()


@pytest.mark.parametrize(
    ("tags", "to_left", "to_right"),
    [
        (DASHED, True, True),
        ({"type": "line_thick", "subtype": "dashed"}, True, True),
        ({"type": "line_thin", "subtype": "solid"}, False, False),
        ({"type": "line_thin", "subtype": "solid_dashed"}, True, False),
        ({"type": "line_thin", "subtype": "dashed_solid"}, False, True),
        ({"type": "virtual"}, False, False),
        ({**DASHED, "lane_change": "no"}, False, False),
        ({"type": "virtual", "lane_change": "yes"}, True, True),
        ({**DASHED, "lane_change__left": "yes", "lane_change__right": "no"}, True, False),
    ],
)
def test_lines_that_may_be_crossed(
    tmp_path: Path, tags: dict[str, str], *, to_left: bool, to_right: bool
) -> None:
    graph = street(tmp_path, tags, "vehicle")
    assert graph.left[51] == (Neighbour(61, opposite=False, lane_change=to_left, border_id=10),)
    assert graph.right[61] == (Neighbour(51, opposite=False, lane_change=to_right, border_id=10),)
    assert graph.right[51] == graph.left[71] == ()


@pytest.mark.parametrize(
    ("participant", "tags", "passes"),
    [
        ("vehicle", {}, True),
        ("vehicle:bus", {}, True),
        ("pedestrian", {}, False),
        ("vehicle", {"subtype": "walkway"}, False),
        ("pedestrian", {"subtype": "walkway"}, True),
        ("vehicle", {"subtype": "bus_lane"}, False),
        ("vehicle:bus", {"subtype": "bus_lane"}, True),
        ("vehicle", {"participant__pedestrian": "yes"}, False),
        ("vehicle:car", {"participant__vehicle": "yes", "subtype": "walkway"}, True),
        ("vehicle", {"subtype": "spaceway"}, False),
        (None, {"subtype": "spaceway"}, True),
    ],
)
def test_who_may_pass(
    tmp_path: Path, participant: str | None, tags: dict[str, str], *, passes: bool
) -> None:
    graph = street(tmp_path, DASHED, participant, **tags)
    assert (Passage(51) in graph.following) is passes
    assert (51 in graph.left) is passes


def test_two_way_lanelets_are_followed_in_both_directions(tmp_path: Path) -> None:
    graph = street(tmp_path, DASHED, "vehicle", one_way="no")
    assert graph.following[Passage(52, reverse=True)] == (Passage(51, reverse=True),)
    assert graph.following[Passage(51)] == (Passage(52),)
    assert Passage(51, reverse=True) not in street(tmp_path, DASHED, "vehicle").following


def test_oncoming_lanes_are_neighbours_that_one_may_not_change_to(tmp_path: Path) -> None:
    lines = [way(k, [10 * k, 10 * k + 1], **DASHED) for k in range(3)]
    lanes = (lanelet(51, [1], [0]), lanelet(61, [1], [2]))
    found = load_map(write_osm(tmp_path / "map.osm", NODES, *lines, *lanes))
    assert found.routing.left[51] == (Neighbour(61, opposite=True, lane_change=False, border_id=1),)
    assert found.routing.left[61] == (Neighbour(51, opposite=True, lane_change=False, border_id=1),)
    assert found.routing.participant == "vehicle"
