"""The street as a Lanelet2 map, exact to the printed digits.

The street is cut at every stop line. Between two cuts there are four lanelets that share
their borders; line strings run along +x, so the lanelets towards -x use them in reverse.
Points carry `local_x`, `local_y` (the map frame: east and north of the origin), `ele`, and
latitude and longitude on WGS 84. The origin stands in `MetaInfo`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from percept.core.geodesy import LocalFrame
from percept.datasets.synthetic.layout import BLOCK_M, Signal, StopLine, block_at
from percept.datasets.synthetic.terrain import (
    KERB_HEIGHT_M,
    KNOT_SPACING_M,
    LANE_WIDTH_M,
    ROAD_HALF_WIDTH_M,
)
from percept.datasets.synthetic.world import World

__all__ = ["BORDERS", "Border", "StreetMap", "make_map", "write_map"]

Point = tuple[float, float, float]

_SPEED_LIMIT_KMH = 50
_SIGNAL_HALF_WIDTH_M, _SIGNAL_HEIGHT_M, _SIGNAL_FACE_M = 0.18, 1.06, 0.12


@dataclass(frozen=True, slots=True)
class Border:
    """A line string along the street: where it is and what it is."""

    y_m: float
    height_m: float
    tags: tuple[tuple[str, str], ...]


def _line(y_m: float, subtype: str, colour: str) -> Border:
    return Border(y_m, 0.0, (("type", "line_thin"), ("subtype", subtype), ("color", colour)))


def _kerb(y_m: float) -> Border:
    return Border(y_m, KERB_HEIGHT_M, (("type", "curbstone"), ("subtype", "high")))


BORDERS: tuple[Border, ...] = (
    _line(-2 * LANE_WIDTH_M, "solid", "white"),
    _line(-LANE_WIDTH_M, "dashed", "white"),
    _line(0.0, "solid_solid", "yellow"),
    _line(LANE_WIDTH_M, "dashed", "white"),
    _line(2 * LANE_WIDTH_M, "solid", "white"),
    _kerb(-ROAD_HALF_WIDTH_M),
    _kerb(ROAD_HALF_WIDTH_M),
)
"""From right to left; the first five border the lanes, line strings in the middle of paint."""

_LANES = ((1, 0), (2, 1), (2, 3), (3, 4))
"""Left and right border of the lanes; the first two lead towards +x, the others towards -x."""


@dataclass(slots=True)
class StreetMap:
    """Primitives of a Lanelet2 map under construction.

    Attributes:
        origin: Where the map frame lies.
        nodes: Point by node id, metres in the map frame.
        ways: Node ids and tags by way id.
        relations: Members (type, role, id) and tags by relation id.
    """

    origin: LocalFrame
    nodes: dict[int, Point] = field(default_factory=dict)
    ways: dict[int, tuple[list[int], dict[str, str]]] = field(default_factory=dict)
    relations: dict[int, tuple[list[tuple[str, str, int]], dict[str, str]]] = field(
        default_factory=dict
    )
    _by_place: dict[Point, int] = field(default_factory=dict)

    def node(self, point: Point) -> int:
        """Return the id of the node at a point; line strings that meet share it."""
        place = (round(point[0], 6), round(point[1], 6), round(point[2], 6))
        if place not in self._by_place:
            self._by_place[place] = len(self.nodes) + 1
            self.nodes[len(self.nodes) + 1] = place
        return self._by_place[place]

    def way(self, identity: int, points: list[Point], tags: dict[str, str]) -> int:
        """Add a line string and return its id."""
        self.ways[identity] = ([self.node(point) for point in points], tags)
        return identity


def make_map(world: World, origin: LocalFrame, blocks: range) -> StreetMap:
    """Return the map of some blocks of a street.

    Args:
        world: The street.
        origin: Where the map frame lies on the earth.
        blocks: Numbers of the blocks, without gaps.
    """
    street = StreetMap(origin)
    cuts = [blocks.start * BLOCK_M]
    for block in blocks:
        cuts += sorted(line.near_x_m for line in block_at(world.seed, block).stop_lines)
    cuts.append(blocks.stop * BLOCK_M)
    pieces = list(pairwise(cuts))
    for number, (start, end) in enumerate(pieces):
        borders = [_add_border(street, world, number, k, start, end) for k in range(len(BORDERS))]
        for lane, (left, right) in enumerate(_LANES):
            _add_lanelet(street, 500_000 + 10 * number + lane, borders[left], borders[right])
    for number, block in enumerate(blocks):
        _add_signals(street, world, number, block)
    return street


def write_map(street: StreetMap, path: Path) -> None:
    """Write a map as OSM XML."""
    root = ET.Element("osm", version="0.6", generator="percept")
    origin = street.origin
    ET.SubElement(
        root,
        "MetaInfo",
        format_version="1",
        map_version="1",
        origin_lat=f"{origin.latitude_deg:.9f}",
        origin_lon=f"{origin.longitude_deg:.9f}",
        origin_ele=f"{origin.altitude_m:.3f}",
    )
    for identity, point in street.nodes.items():
        latitude, longitude, altitude = origin.geodetic(np.array(point))
        node = ET.SubElement(
            root, "node", id=str(identity), lat=f"{latitude:.11f}", lon=f"{longitude:.11f}"
        )
        local = {"local_x": f"{point[0]:.6f}", "local_y": f"{point[1]:.6f}"}
        _add_tags(node, {**local, "ele": f"{altitude:.6f}"})
    for identity, (nodes, tags) in street.ways.items():
        way = ET.SubElement(root, "way", id=str(identity))
        for reference in nodes:
            ET.SubElement(way, "nd", ref=str(reference))
        _add_tags(way, tags)
    for identity, (members, tags) in street.relations.items():
        relation = ET.SubElement(root, "relation", id=str(identity))
        for kind, role, reference in members:
            ET.SubElement(relation, "member", type=kind, role=role, ref=str(reference))
        _add_tags(relation, tags)
    ET.indent(root)
    path.write_bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


def _add_tags(element: ET.Element, tags: dict[str, str]) -> None:
    for key, value in tags.items():
        ET.SubElement(element, "tag", k=key, v=value)


def _add_border(
    street: StreetMap, world: World, piece: int, k: int, start: float, end: float
) -> int:
    border = BORDERS[k]
    first = int(np.floor(start / KNOT_SPACING_M)) + 1
    knots = np.arange(first, int(np.ceil(end / KNOT_SPACING_M))) * KNOT_SPACING_M
    xs = np.concatenate([[start], knots, [end]])
    zs = world.profile.height(xs) + border.height_m
    points = [(float(x), border.y_m, float(z)) for x, z in zip(xs, zs, strict=True)]
    return street.way(100_000 + 10 * piece + k, points, dict(border.tags))


def _add_lanelet(street: StreetMap, identity: int, left: int, right: int) -> None:
    members = [("way", "left", left), ("way", "right", right)]
    tags = {
        "type": "lanelet",
        "subtype": "road",
        "location": "urban",
        "one_way": "yes",
        "speed_limit": str(_SPEED_LIMIT_KMH),
        "participant:vehicle": "yes",
    }
    street.relations[identity] = (members, tags)


def _add_signals(street: StreetMap, world: World, number: int, block: int) -> None:
    """Add stop lines, heads and rules; the lanes before a stop line obey its heads."""
    content = block_at(world.seed, block)
    facing_east = [s for s in content.signals if s.head.yaw_rad > 0]
    facing_west = [s for s in content.signals if s.head.yaw_rad < 0]
    before_east, after_west = 2 * number, 2 * number + 2
    for k, (stop, heads, piece, lanes) in enumerate(
        (
            (content.stop_lines[0], facing_east, before_east, (0, 1)),
            (content.stop_lines[1], facing_west, after_west, (2, 3)),
        )
    ):
        line = _add_stop_line(street, world, 300_000 + 10 * number + k, stop)
        lights = [_add_head(street, world, signal) for signal in heads]
        rule = 400_000 + 10 * number + k
        members = [("way", "refers", light) for light in lights] + [("way", "ref_line", line)]
        street.relations[rule] = (
            members,
            {"type": "regulatory_element", "subtype": "traffic_light"},
        )
        for lane in lanes:
            obeying = street.relations[500_000 + 10 * piece + lane]
            obeying[0].append(("relation", "regulatory_element", rule))


def _add_stop_line(street: StreetMap, world: World, identity: int, stop: StopLine) -> int:
    z = float(world.profile.height(stop.near_x_m))
    points = [(stop.near_x_m, y, z) for y in stop.y_range_m]
    width = abs(stop.far_x_m - stop.near_x_m)
    return street.way(identity, points, {"type": "stop_line", "width": f"{width:.2f}"})


def _add_head(street: StreetMap, world: World, signal: Signal) -> int:
    """Add a head as the lower edge of its face, from left to right for who looks at it."""
    T_map_head = world.place(signal.head, 0.0)
    edge = np.array(
        [[x, _SIGNAL_FACE_M, 0.0] for x in (_SIGNAL_HALF_WIDTH_M, -_SIGNAL_HALF_WIDTH_M)]
    )
    points = edge @ T_map_head[:3, :3].T + T_map_head[:3, 3]
    tags = {
        "type": "traffic_light",
        "subtype": "red_yellow_green",
        "height": f"{_SIGNAL_HEIGHT_M:.2f}",
    }
    corners: list[Point] = [(float(x), float(y), float(z)) for x, y, z in points]
    return street.way(signal.head.object_id, corners, tags)
