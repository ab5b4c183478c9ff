"""Traffic lights of a map, from its line strings, polygons and regulatory elements.

By Lanelet2's convention (LinestringTagging and RegulatoryElementTagging of its documentation)
a light is the lower edge of its face, drawn from left to right as who obeys it sees it, with
the tag `height`; or the outline of the face as a polygon, whose points run clockwise for who
obeys it. Autoware adds line strings of type `light_bulbs` whose points have a `color`.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.coordinates import MapPoints
from percept.hdmap.light import MapLight
from percept.hdmap.osm import OsmRelation, OsmWay

__all__ = ["map_lights"]

_F64 = NDArray[np.float64]
_COLOURS = frozenset({"red", "yellow", "green"})
_YES = ("yes", "true")
_LEAST_SIDE_M = 0.01
_SAME_HEIGHT_M = 0.1
_NO_WIDTH = "traffic lights without width, whose facing is not known"
_NO_HEIGHT = "traffic lights without a height"


def map_lights(
    points: MapPoints,
    point_tags: Mapping[int, Mapping[str, str]],
    ways: Mapping[int, OsmWay],
    relations: Mapping[int, OsmRelation],
    dropped: Counter[str],
) -> tuple[MapLight, ...]:
    """Return the lights of a map by their ids rising.

    Args:
        points: Points of the map.
        point_tags: Tags of points by id.
        ways: Line strings and polygons whose points are all there.
        relations: Regulatory elements, among others.
        dropped: Takes the lights that have no face, by reason.
    """
    groups, bulb_ways = _rules(ways, relations)
    lights = []
    for light_id in sorted(i for i, way in ways.items() if way.tags.get("type") == "traffic_light"):
        way = ways[light_id]
        outline = points.xyz_map[points.rows(np.array(way.nodes, dtype=np.int64))]
        corners = _corners(outline, way, dropped)
        if corners is None:
            continue
        bulb_ids = [node for bulbs in bulb_ways[light_id] for node in ways[bulbs].nodes]
        bulbs = _bulbs_of_points(points, point_tags, bulb_ids, corners)
        lights.append(
            MapLight(
                light_id=light_id,
                corners_map=corners,
                facing=_facing(corners[1] - corners[0]),
                bulbs=bulbs or _bulbs_of_subtype(way.tags.get("subtype", "")),
                group_ids=tuple(sorted(groups[light_id])),
            )
        )
    return tuple(lights)


def _rules(
    ways: Mapping[int, OsmWay], relations: Mapping[int, OsmRelation]
) -> tuple[defaultdict[int, set[int]], defaultdict[int, set[int]]]:
    """Return regulatory elements, and ways of bulbs, by the id of the light."""
    groups: defaultdict[int, set[int]] = defaultdict(set)
    bulbs: defaultdict[int, set[int]] = defaultdict(set)
    for identity, relation in relations.items():
        if relation.tags.get("subtype") != "traffic_light":
            continue
        for member in relation.members:
            if member.kind == "way" and member.role == "refers":
                groups[member.ref].add(identity)
    for identity, way in ways.items():
        light = way.tags.get("traffic_light_id", "")
        if way.tags.get("type") == "light_bulbs" and light.lstrip("-").isdecimal():
            bulbs[int(light)].add(identity)
    return groups, bulbs


def _corners(outline: _F64, way: OsmWay, dropped: Counter[str]) -> _F64 | None:
    """Return the corners (4, 3) of a face from an edge or an outline; None counts what lacks."""
    polygon = way.tags.get("area") in _YES or way.nodes[0] == way.nodes[-1]
    corners = _corners_of_outline(outline) if polygon else _corners_of_edge(outline, way)
    if not np.hypot(*(corners[1] - corners[0])[:2]) >= _LEAST_SIDE_M:
        dropped[_NO_WIDTH] += 1
        return None
    if not corners[3, 2] - corners[0, 2] >= _LEAST_SIDE_M:
        dropped[_NO_HEIGHT] += 1
        return None
    return corners


def _corners_of_edge(edge: _F64, way: OsmWay) -> _F64:
    left, right = edge[0], edge[-1]
    up = np.array([0.0, 0.0, _height(way.tags.get("height", ""))])
    return np.array([left, right, right + up, left + up])


def _height(text: str) -> float:
    try:
        height = float(text)
    except ValueError:
        return math.nan
    return height if math.isfinite(height) else math.nan


def _corners_of_outline(outline: _F64) -> _F64:
    """Return the upright rectangle (4, 3) about an outline, in the plane that fits it.

    Newell's sum of the outline's edges is normal to it, and points away from whom the points
    run clockwise for.
    """
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    spokes = outline - middle
    away = np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)
    right = np.array([away[1], -away[0], 0.0]) / max(np.hypot(away[0], away[1]), 1e-12)
    along = spokes @ right
    low, high = outline[:, 2].min(), outline[:, 2].max()
    ends = [middle + along.min() * right, middle + along.max() * right]
    return np.array(
        [[*ends[0][:2], low], [*ends[1][:2], low], [*ends[1][:2], high], [*ends[0][:2], high]]
    )


def _facing(to_the_right: _F64) -> _F64:
    """Return the level unit vector (3,) from a face towards whom its edge runs to the right for."""
    x, y = to_the_right[:2].tolist()
    return np.array([y, -x, 0.0]) / math.hypot(x, y)


def _bulbs_of_points(
    points: MapPoints,
    point_tags: Mapping[int, Mapping[str, str]],
    bulb_ids: Iterable[int],
    corners: _F64,
) -> tuple[str, ...]:
    """Return the colours of bulbs from the top, of one height from the left."""
    to_the_right = corners[1] - corners[0]
    placed = []
    for identity in bulb_ids:
        colour = point_tags[identity].get("color", "")
        if colour in _COLOURS:
            xyz = points.xyz_map[points.rows(np.array([identity]))[0]]
            level = round(float(corners[3, 2] - xyz[2]) / _SAME_HEIGHT_M)
            placed.append((level, float((xyz - corners[0]) @ to_the_right), colour))
    return tuple(colour for _, _, colour in sorted(placed))


def _bulbs_of_subtype(subtype: str) -> tuple[str, ...]:
    colours = tuple(subtype.split("_"))
    return colours if set(colours) <= _COLOURS else ()
