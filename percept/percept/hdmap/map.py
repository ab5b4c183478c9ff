"""A map in memory: points, line strings and relations, and what they make of the road."""

from __future__ import annotations

import gc
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.core.polyline import points_along
from percept.hdmap.coordinates import MapPoints, place_points
from percept.hdmap.elements import Lanelet, MapArea, MapMarking, RegulatoryElement
from percept.hdmap.georeference import Georeference
from percept.hdmap.lanelets import map_areas, map_lanelets
from percept.hdmap.light import MapLight
from percept.hdmap.lights import map_lights
from percept.hdmap.markings import map_markings
from percept.hdmap.opendrive import OpenDriveMap, is_opendrive, load_opendrive
from percept.hdmap.osm import OsmFile, OsmRelation, OsmWay, read_osm
from percept.hdmap.routing import RoutingGraph, make_routing
from percept.hdmap.rules import map_rules

__all__ = ["HdMap", "load_map"]

_DENSE_M = 5.0
_LOST_WAY = "line strings without points, or with one that the file does not hold"
_LOST_MEMBER = "members of relations that the file does not hold"


@dataclass(frozen=True, eq=False, kw_only=True)
class HdMap:
    """A Lanelet2 map, or the lane markings of an OpenDRIVE map.

    Attributes:
        origin: Where its frame lies on the earth; None where the map does not say.
        georeference: The way between its frame and latitude and longitude; None where the map
            does not say it.
        points: Its points in the map frame.
        point_tags: Tags of points by id.
        line_strings: Line strings and polygons by id; all their points are there.
        shapes: Their points (K, 3) in the map frame.
        relations: Lanelets, areas and regulatory elements by id; a member may be missing.
        lights: Traffic lights, by their ids rising.
        lanelets: Lanelets by id.
        areas: Areas by id.
        rules: Regulatory elements by id.
        markings: Lines, stop lines and crosswalks by the ids of their line strings, rising.
        dropped: What the file holds and this does not, and what was assumed, by reason.
    """

    origin: LocalFrame | None
    georeference: Georeference | None
    points: MapPoints
    point_tags: Mapping[int, Mapping[str, str]]
    line_strings: Mapping[int, OsmWay]
    shapes: Mapping[int, NDArray[np.float64]]
    relations: Mapping[int, OsmRelation]
    lights: tuple[MapLight, ...]
    lanelets: Mapping[int, Lanelet]
    areas: Mapping[int, MapArea]
    rules: Mapping[int, RegulatoryElement]
    markings: tuple[MapMarking, ...]
    dropped: Counter[str]

    @cached_property
    def routing(self) -> RoutingGraph:
        """How the lanelets that vehicles may use hang together."""
        return make_routing(self.lanelets, self.line_strings)

    def points_of(self, line_id: int) -> NDArray[np.float64]:
        """Return the points (K, 3) of a line string in the map frame, metres."""
        return self.shapes[line_id]

    def distance_m(self, points_map: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far (N,) points (N, 2 or more) lie from the nearest line of the map, level.

        Lines are taken as points at most 5 m apart: from near a line the distance is up to 2.5 m
        too large, from 100 m away 3 cm.
        """
        found: NDArray[np.float64] = self._nearest.query(points_map[:, :2])[0]
        return found

    @cached_property
    def _nearest(self) -> cKDTree:
        points = points_along(self.shapes.values(), _DENSE_M)
        return cKDTree(points if len(points) else self.points.xyz_map[:, :2])


def load_map(path: Path, origin: LocalFrame | None = None, *, anywhere: bool = False) -> HdMap:
    """Read a map: Lanelet2 in OSM XML, or the lane markings of OpenDRIVE (`.xodr`).

    Args:
        path: The file.
        origin: Where the map frame lies, so that points are placed by latitude and longitude;
            None takes local coordinates where the map has them, or the origin that it names.
        anywhere: Lay a map that does not say where its frame lies about its own middle, instead
            of refusing it: for what does not depend on where that is.

    Raises:
        InputError: If the file is no map, or its points cannot be placed in one frame.
    """
    if is_opendrive(path):
        return _of_opendrive(load_opendrive(path, origin))
    with _garbage_left():
        return _of_lanelet2(path, origin, anywhere=anywhere)


@contextmanager
def _garbage_left() -> Iterator[None]:
    """Do not look for garbage: a map is millions of objects, all in use (a third of the time)."""
    searched = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searched:
            gc.enable()


def _of_lanelet2(path: Path, origin: LocalFrame | None, *, anywhere: bool) -> HdMap:
    file = read_osm(path)
    if not file.nodes:
        raise InputError("holds no points", where=path)
    placement = place_points(file, origin, path, anywhere=anywhere)
    points, dropped = placement.points, placement.assumed
    shapes = points.shapes(file.ways)
    whole = {identity: way for identity, way in file.ways.items() if identity in shapes}
    if len(whole) < len(file.ways):
        dropped[_LOST_WAY] = len(file.ways) - len(whole)
    lost = _lost_members(file)
    if lost:
        dropped[_LOST_MEMBER] = lost
    tags = {identity: node.tags for identity, node in file.nodes.items()}
    lights = map_lights(points, tags, whole, file.relations, dropped)
    lanelets = map_lanelets(whole, file.relations, shapes, dropped)
    rules = map_rules(file.relations)
    return HdMap(
        origin=placement.origin,
        georeference=placement.georeference,
        points=points,
        point_tags=tags,
        line_strings=whole,
        shapes=shapes,
        relations=file.relations,
        lights=lights,
        lanelets=lanelets,
        areas=map_areas(whole, file.relations, shapes, dropped),
        rules=rules,
        markings=map_markings(whole, lanelets, rules, shapes, dropped),
        dropped=dropped,
    )


def _of_opendrive(drive: OpenDriveMap) -> HdMap:
    """Return a map whose line strings are the markings of the lanes, with tags as of Lanelet2."""
    ways = {
        marking.element_id: OsmWay(nodes, _tags(marking))
        for marking, nodes in zip(drive.markings, drive.nodes, strict=True)
    }
    return HdMap(
        origin=drive.origin,
        georeference=drive.georeference,
        points=drive.points,
        point_tags={},
        line_strings=ways,
        shapes={marking.element_id: marking.points_map for marking in drive.markings},
        relations={},
        lights=(),
        lanelets={},
        areas={},
        rules={},
        markings=drive.markings,
        dropped=drive.dropped,
    )


def _tags(marking: MapMarking) -> dict[str, str]:
    if not marking.painted:
        return {"type": "road_border", "name": marking.name}
    tags = {"type": "line_thin", "subtype": marking.type, "color": marking.colour}
    return tags | {"name": marking.name}


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
