"""Maps against the lanelet2 package: the same primitives at the same places."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from percept.core.geodesy import LocalFrame
from percept.datasets.synthetic.drive import MAP_ORIGIN
from percept.datasets.synthetic.lanelet_map import make_map, write_map
from percept.datasets.synthetic.world import World
from percept.hdmap import HdMap, load_map

lanelet2 = pytest.importorskip("lanelet2")


def check(path: Path, ours: HdMap, origin: LocalFrame) -> None:
    place = lanelet2.io.Origin(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    projector = lanelet2.projection.LocalCartesianProjector(place)
    # Robust, since it knows not all regulatory elements of Autoware.
    theirs: Any = lanelet2.io.loadRobust(str(path), projector)[0]
    points = {p.id: (p.x, p.y, p.z) for p in theirs.pointLayer}
    assert set(points) == set(ours.points.ids.tolist())
    expected = np.array([points[i] for i in ours.points.ids.tolist()])
    np.testing.assert_allclose(ours.points.xyz_map, expected, atol=1e-3, rtol=0)
    lines = {line.id: [p.id for p in line] for line in theirs.lineStringLayer}
    for identity, nodes in lines.items():
        assert list(ours.line_strings[identity].nodes) == nodes
    assert len(ours.line_strings) == len(lines) + len(theirs.polygonLayer)
    assert {e.id for e in theirs.laneletLayer} <= set(ours.relations)
    lights = {
        light.id: rule.id
        for rule in theirs.regulatoryElementLayer
        if "refers" in rule.parameters
        for light in rule.parameters["refers"]
        if rule.attributes["subtype"] == "traffic_light"
    }
    assert {light.light_id for light in ours.lights if light.group_ids} == set(lights)
    for light in ours.lights:
        assert not light.group_ids or lights[light.light_id] in light.group_ids


def test_the_synthetic_map_is_as_lanelet2_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "street.osm"
    write_map(make_map(World.from_seed(5), MAP_ORIGIN, range(-1, 3)), path)
    ours = load_map(path)
    assert len(ours.lights) == 16
    check(path, ours, MAP_ORIGIN)


@pytest.mark.parametrize(
    ("name", "origin", "lights"),
    [
        ("lanelet2_validator/sample_map.osm", LocalFrame(35.903, 139.933, 19.0), 23),
        ("lanelet2_validator/lane/shoulder_road_without_adjacent.osm", None, 0),
    ],
)
def test_real_maps_are_as_lanelet2_reads_them(
    shared_data: Path, name: str, origin: LocalFrame | None, lights: int
) -> None:
    path = shared_data / "hdmap" / name
    place = origin or LocalFrame(35.9, 139.9, 0.0)
    ours = load_map(path, place)
    assert len(ours.lights) == lights
    check(path, ours, place)
