"""Maps against the lanelet2 package: the same primitives at the same places, the same routes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_osm import lanelet, node, way, write_osm

from percept.core.geodesy import LocalFrame
from percept.datasets.synthetic.drive import MAP_ORIGIN
from percept.datasets.synthetic.lanelet_map import make_map, write_map
from percept.datasets.synthetic.world import World
from percept.hdmap import HdMap, load_map
from percept.hdmap.routing import Passage, RoutingGraph, make_routing
from percept.hdmap.transverse_mercator import TransverseMercator

lanelet2 = pytest.importorskip("lanelet2")

PARTICIPANTS = ("vehicle", "vehicle:bus", "bicycle", "pedestrian")


def load_both(path: Path, origin: LocalFrame) -> tuple[HdMap, Any]:
    place = lanelet2.io.Origin(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    projector = lanelet2.projection.LocalCartesianProjector(place)
    # Robust, since it knows not all regulatory elements of Autoware.
    return load_map(path, origin), lanelet2.io.loadRobust(str(path), projector)[0]


def check(path: Path, origin: LocalFrame) -> HdMap:
    """Hold what a map is made of against the other reader."""
    ours, theirs = load_both(path, origin)
    points = {p.id: (p.x, p.y, p.z) for p in theirs.pointLayer}
    assert set(points) == set(ours.points.ids.tolist())
    if points:
        expected = np.array([points[i] for i in ours.points.ids.tolist()])
        np.testing.assert_allclose(ours.points.xyz_map, expected, atol=1e-3, rtol=0)
    lines = [*theirs.lineStringLayer, *theirs.polygonLayer]
    assert {line.id for line in lines} == set(ours.line_strings)
    for line in lines:
        way_of = ours.line_strings[line.id]
        assert list(way_of.nodes) == [p.id for p in line]
        tags = dict(line.attributes.items())
        assert {k: v for k, v in way_of.tags.items() if k != "area"} == without_area(tags)
    check_lanelets(ours, theirs)
    check_lights(ours, theirs)
    return ours


def without_area(tags: dict[str, str]) -> dict[str, str]:
    return {key: value for key, value in tags.items() if key != "area"}


def check_lanelets(ours: HdMap, theirs: Any) -> None:
    assert {one.id for one in theirs.laneletLayer} == set(ours.lanelets)
    for one in theirs.laneletLayer:
        lane = ours.lanelets[one.id]
        assert lane.left_ids == (one.leftBound.id,)
        assert lane.left_nodes == tuple(p.id for p in one.leftBound)
        assert lane.right_nodes == tuple(p.id for p in one.rightBound)
        assert dict(lane.tags) == dict(one.attributes.items())
    rules = {rule.id: rule for rule in theirs.regulatoryElementLayer}
    assert set(rules) <= set(ours.rules)
    for identity, rule in rules.items():
        assert ours.rules[identity].subtype == rule.attributes["subtype"]


def check_lights(ours: HdMap, theirs: Any) -> None:
    lights = {
        light.id: rule.id
        for rule in theirs.regulatoryElementLayer
        if "refers" in rule.parameters
        for light in rule.parameters["refers"]
        if rule.attributes["subtype"] == "traffic_light"
        and "type" in light.attributes
        and light.attributes["type"] == "traffic_light"
    }
    ours_of_rules = {light.light_id for light in ours.lights if light.group_ids}
    # A face without a height is no light to us.
    assert ours_of_rules <= set(lights)
    assert len(lights) - len(ours_of_rules) <= ours.dropped.total()
    for light in ours.lights:
        assert not light.group_ids or lights[light.light_id] in light.group_ids


def check_routing(ours: HdMap, theirs: Any, participant: str) -> int:
    """Hold the graphs of a participant against each other; return the number of edges."""
    rules = lanelet2.traffic_rules.create("de", participant)
    their_graph = lanelet2.routing.RoutingGraph(theirs, rules)
    graph = make_routing(ours.lanelets, ours.line_strings, participant)
    edges = 0
    for one in theirs.laneletLayer:
        for reverse in (False, True):
            passage, driven = Passage(one.id, reverse), one.invert() if reverse else one
            assert rules.canPass(driven) == (passage in graph.following)
            if passage in graph.following:
                after = {Passage(x.id, x.inverted()) for x in their_graph.following(driven)}
                before = {Passage(x.id, x.inverted()) for x in their_graph.previous(driven)}
                assert set(graph.following[passage]) == after
                assert set(graph.previous[passage]) == before
                edges += len(after)
        if Passage(one.id) in graph.following:
            edges += check_beside(graph, their_graph, one)
    return edges


def check_beside(graph: RoutingGraph, their_graph: Any, one: Any) -> int:
    edges = 0
    for name, ours in (("left", graph.left[one.id]), ("right", graph.right[one.id])):
        to_change = getattr(their_graph, name)(one)
        beside = getattr(their_graph, f"adjacent{name.capitalize()}")(one)
        passable = [n for n in ours if Passage(n.lanelet_id, n.opposite) in graph.following]
        for found, change in ((to_change, True), (beside, False)):
            ids = {n.lanelet_id for n in passable if n.lane_change is change}
            assert (found is not None) == bool(ids)
            assert found is None or found.id in ids
            edges += len(ids)
    return edges


def test_the_synthetic_map_is_as_lanelet2_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "street.osm"
    write_map(make_map(World.from_seed(5), MAP_ORIGIN, range(-1, 3)), path)
    ours = load_map(path)
    assert len(ours.lights) == 16
    np.testing.assert_allclose(
        check(path, MAP_ORIGIN).points.xyz_map, ours.points.xyz_map, atol=2e-3
    )
    _, theirs = load_both(path, MAP_ORIGIN)
    assert check_routing(ours, theirs, "vehicle") > 100


def test_the_example_of_lanelet2(shared_data: Path) -> None:
    path = shared_data / "hdmap" / "lanelet2_example" / "mapping_example-debug.osm"
    ours = check(path, LocalFrame(49.0, 8.4, 0.0))
    assert (len(ours.points), len(ours.line_strings)) == (328, 436)


def test_every_map_of_the_validator(shared_data: Path) -> None:
    paths = sorted((shared_data / "hdmap" / "lanelet2_validator").rglob("*.osm"))
    assert len(paths) > 80
    edges = 0
    for path in paths:
        found = load_map(path, anywhere=True)
        assert found.georeference is not None
        frame = found.georeference.frame
        ours = check(path, frame)
        _, theirs = load_both(path, frame)
        edges += sum(check_routing(ours, theirs, who) for who in PARTICIPANTS)
    assert edges > 3000


@pytest.mark.parametrize("one_way", ["yes", "no"])
@pytest.mark.parametrize("subtype", ["solid", "dashed", "solid_dashed", "dashed_solid"])
@pytest.mark.parametrize("low_reversed", [True, False])
def test_routes_of_made_maps(
    tmp_path: Path, one_way: str, subtype: str, *, low_reversed: bool
) -> None:
    """Four rows of four lanelets, some lines drawn backwards, one row running the other way."""
    nodes = [
        node(100 * row + k, 20.0 * k, 3.0 * row + 0.02 * k**2).replace(
            'lat="" lon=""', f'lat="{49 + 2.7e-5 * row + 1.8e-7 * k**2}" lon="{8.4 + 2.74e-4 * k}"'
        )
        for row in range(5)
        for k in range(5)
    ]
    lines, lanes = [], []
    for row in range(5):
        for k in range(4):
            ids = [100 * row + k, 100 * row + k + 1]
            kind = {"type": "line_thin", "subtype": subtype if row != 3 else "dashed"}
            back = low_reversed and row in (1, 2)
            lines.append(way(1000 + 10 * row + k, ids[::-1] if back else ids, **kind))
    for row in range(4):
        for k in range(4):
            low, high = [1000 + 10 * row + k], [1010 + 10 * row + k]
            left, right = (low, high) if row == 3 else (high, low)
            lanes.append(lanelet(5000 + 10 * row + k, left, right, one_way=one_way))
    path = write_osm(tmp_path / "map.osm", *nodes, *lines, *lanes)
    ours, theirs = load_both(path, LocalFrame(49.0, 8.4, 0.0))
    check_lanelets(ours, theirs)
    assert check_routing(ours, theirs, "vehicle") >= 28


def test_grids_are_those_of_its_utm_projector() -> None:
    origin = lanelet2.io.Origin(0.0, 9.0)
    projector = lanelet2.projection.UtmProjector(origin, False, False)  # noqa: FBT003
    places = np.random.default_rng(2).uniform((1.0, 6.0), (70.0, 12.0), (50, 2))
    found = TransverseMercator.utm(32).grid(places)
    for (latitude, longitude), grid in zip(places.tolist(), found, strict=True):
        expected = projector.forward(lanelet2.core.GPSPoint(latitude, longitude, 0.0))
        np.testing.assert_allclose(grid, (expected.x, expected.y), atol=1e-6)
