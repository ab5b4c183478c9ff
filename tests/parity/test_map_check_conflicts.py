"""Which lanelets conflict, against the routing graph of the lanelet2 package."""

from __future__ import annotations

from pathlib import Path

import pytest

from percept.hdmap import load_map
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.intersection_conflict import conflicts_of

lanelet2 = pytest.importorskip("lanelet2")

_FOLDER = "hdmap/lanelet2_validator"
_MAPS = ("sample_map.osm", "intersection/virtual_traffic_light_with_derailed_stop_line.osm")


@pytest.mark.parametrize("name", _MAPS)
def test_conflicts_are_those_of_lanelet2(shared_data: Path, name: str) -> None:
    path = shared_data / _FOLDER / name
    if not path.is_file():
        pytest.skip(f"the map {_FOLDER}/{name} is not among the shared data")
    origin = lanelet2.io.Origin(35.9032, 139.9335)  # beside the maps
    projector = lanelet2.projection.LocalCartesianProjector(origin)
    # Robust, since it knows not all regulatory elements of Autoware.
    theirs = lanelet2.io.loadRobust(str(path), projector)[0]
    rules = lanelet2.traffic_rules.create(
        lanelet2.traffic_rules.Locations.Germany, lanelet2.traffic_rules.Participants.Vehicle
    )
    graph = lanelet2.routing.RoutingGraph(theirs, rules)
    checked = CheckedMap(load_map(path))
    expected = {
        one.id: sorted(other.id for other in graph.conflicting(one))
        for one in theirs.laneletLayer
        if rules.canPass(one)
    }
    assert sum(map(len, expected.values())) > 10
    assert {
        lanelet: [conflict.lanelet_id for conflict in conflicts_of(checked, lanelet)]
        for lanelet in expected
    } == expected
