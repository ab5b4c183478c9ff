"""A map in memory: points, line strings and relations, and the lights that they make."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap.coordinates import MapPoints, place_points
from percept.hdmap.light import MapLight
from percept.hdmap.lights import map_lights
from percept.hdmap.osm import OsmFile, OsmRelation, OsmWay, read_osm

__all__ = ["HdMap", "load_map"]

_LOST_WAY = "line strings without points, or with one that the file does not hold"
_LOST_MEMBER = "members of relations that the file does not hold"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HdMap:
    """A Lanelet2 map.

    Attributes:
        origin: Where its frame lies on the earth; None where the map does not say.
        points: Its points in the map frame.
        point_tags: Tags of points by id.
        line_strings: Line strings and polygons by id; all their points are there.
        relations: Lanelets, areas and regulatory elements by id; a member may be missing.
        lights: Traffic lights, by their ids rising.
        dropped: What the file holds and this does not, and what was assumed, by reason.
    """

    origin: LocalFrame | None
    points: MapPoints
    point_tags: Mapping[int, Mapping[str, str]]
    line_strings: Mapping[int, OsmWay]
    relations: Mapping[int, OsmRelation]
    lights: tuple[MapLight, ...]
    dropped: Counter[str]

    def points_of(self, line_id: int) -> NDArray[np.float64]:
        """Return the points (K, 3) of a line string in the map frame, metres."""
        ids = np.array(self.line_strings[line_id].nodes, dtype=np.int64)
        return self.points.xyz_map[self.points.rows(ids)]


def load_map(path: Path, origin: LocalFrame | None = None) -> HdMap:
    """Read a Lanelet2 map.

    Args:
        path: The OSM file.
        origin: Where the map frame lies, so that points are placed by latitude and longitude;
            None takes local coordinates where the map has them, or the origin that it names.

    Raises:
        InputError: If the file is no map, or its points cannot be placed in one frame.
    """
    file = read_osm(path)
    if not file.nodes:
        raise InputError("holds no points", where=path)
    points, frame, dropped = place_points(file, origin, path)
    whole = _whole_ways(file, points, dropped)
    lost = _lost_members(file)
    if lost:
        dropped[_LOST_MEMBER] = lost
    tags = {identity: node.tags for identity, node in file.nodes.items()}
    lights = map_lights(points, tags, whole, file.relations, dropped)
    return HdMap(
        origin=frame,
        points=points,
        point_tags=tags,
        line_strings=whole,
        relations=file.relations,
        lights=lights,
        dropped=dropped,
    )


def _whole_ways(file: OsmFile, points: MapPoints, dropped: Counter[str]) -> dict[int, OsmWay]:
    """Return the ways of which every point is there; count the others."""
    whole = {
        identity: way
        for identity, way in file.ways.items()
        if way.nodes and (points.rows(np.array(way.nodes, dtype=np.int64)) >= 0).all()
    }
    if len(whole) < len(file.ways):
        dropped[_LOST_WAY] = len(file.ways) - len(whole)
    return whole


def _lost_members(file: OsmFile) -> int:
    held: dict[str, Mapping[int, object]] = {
        "node": file.nodes,
        "way": file.ways,
        "relation": file.relations,
    }
    return sum(
        member.ref not in held.get(member.kind, {})
        for relation in file.relations.values()
        for member in relation.members
    )
