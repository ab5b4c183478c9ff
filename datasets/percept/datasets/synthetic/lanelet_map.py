"""The street as a Lanelet2 map, exact to the printed digits.

The street is cut at every stop line and wherever its grade changes, so that no element is
longer than 30 m. Between two cuts there are four lanelets that share their borders; line
strings run along +x, so the lanelets towards -x use them in reverse. Points carry `local_x`,
`local_y` (the map frame: east and north of the origin), `ele`, and latitude and longitude on
WGS 84. The origin stands in `MetaInfo`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.geodesy import LocalFrame
from percept.datasets.synthetic.furniture import LAMPS, signal_lamps
from percept.datasets.synthetic.layout import BLOCK_M, Placed, StopLine, block_at
from percept.datasets.synthetic.terrain import (
    KERB_HEIGHT_M,
    KNOT_SPACING_M,
    LANE_WIDTH_M,
    ROAD_HALF_WIDTH_M,
)
from percept.datasets.synthetic.world import World

__all__ = [
    "BORDERS",
    "Border",
    "Piece",
    "StreetMap",
    "add_head",
    "border_id",
    "make_map",
    "signal_rule_id",
    "stop_line_id",
    "street_pieces",
    "write_map",
]

Point = tuple[float, float, float]

_SPEED_LIMIT_KMH = 50
_SIGNAL_HALF_WIDTH_M, _SIGNAL_HEIGHT_M, _SIGNAL_FACE_M = 0.18, 1.06, 0.12
_BULBS = 500
"""From the id of a head to that of its lamps."""


@dataclass(frozen=True, slots=True)
class Border:
    """A line string along the street: where it is and what it is."""

    y_m: float
    height_m: float
    tags: tuple[tuple[str, str], ...]


def _line(y_m: float, subtype: str, colour: str) -> Border:
    tags = {"type": "line_thin", "subtype": subtype, "color": colour}
    tags["lane_change"] = "yes" if subtype == "dashed" else "no"
    return Border(y_m, 0.0, tuple(tags.items()))


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


@dataclass(frozen=True, slots=True)
class Piece:
    """A piece of the street between two cuts of the map.

    Attributes:
        number: Its number in the map, from 0 on along +x.
        start_m: Where it begins along the street.
        end_m: Where it ends.
    """

    number: int
    start_m: float
    end_m: float


@dataclass(slots=True)
class StreetMap:
    """Primitives of a Lanelet2 map under construction.

    Attributes:
        origin: Where the map frame lies.
        nodes: Point by node id, metres in the map frame.
        node_tags: What a node is beside its place, by node id.
        ways: Node ids and tags by way id.
        relations: Members (type, role, id) and tags by relation id.
    """

    origin: LocalFrame
    nodes: dict[int, Point] = field(default_factory=dict)
    node_tags: dict[int, dict[str, str]] = field(default_factory=dict)
    ways: dict[int, tuple[list[int], dict[str, str]]] = field(default_factory=dict)
    relations: dict[int, tuple[list[tuple[str, str, int]], dict[str, str]]] = field(
        default_factory=dict
    )
    _by_place: dict[Point, int] = field(default_factory=dict)

    def node(self, point: Point) -> int:
        """Return the id of the node at a point; line strings that meet share it."""
        place = (round(point[0], 6), round(point[1], 6), round(point[2], 6))
        if place not in self._by_place:
            self._by_place[place] = len(self._by_place) + 1
            self.nodes[self._by_place[place]] = place
        return self._by_place[place]

    def way(self, identity: int, points: list[Point], tags: dict[str, str]) -> int:
        """Add a line string and return its id."""
        self.ways[identity] = ([self.node(point) for point in points], tags)
        return identity


def street_pieces(world: World, blocks: range) -> list[Piece]:
    """Return the pieces that the map of some blocks is cut into: at stop lines and at knots."""
    cuts = {float(block * BLOCK_M) for block in (*blocks, blocks.stop)}
    for block in blocks:
        cuts |= {line.near_x_m for line in block_at(world.seed, block).stop_lines}
    knots = np.arange(min(cuts), max(cuts), KNOT_SPACING_M)
    ends = pairwise(sorted(cuts | set(knots.tolist())))
    return [Piece(number, start, end) for number, (start, end) in enumerate(ends)]


def border_id(piece: Piece, border: int) -> int:
    """Return the line string of a border of `BORDERS`, by its number, along a piece."""
    return 100_000 + 10 * piece.number + border


def stop_line_id(number: int, *, towards_west: bool = False) -> int:
    """Return the stop line in the `number`-th block of a map."""
    return 300_000 + 10 * number + towards_west


def signal_rule_id(number: int, *, towards_west: bool = False) -> int:
    """Return the regulatory element of the signal in the `number`-th block of a map."""
    return 400_000 + 10 * number + towards_west


def make_map(world: World, origin: LocalFrame, blocks: range) -> StreetMap:
    """Return the map of some blocks of a street.

    Args:
        world: The street.
        origin: Where the map frame lies on the earth.
        blocks: Numbers of the blocks, without gaps.
    """
    street = StreetMap(origin)
    pieces = street_pieces(world, blocks)
    for piece in pieces:
        for k in range(len(BORDERS)):
            _add_border(street, world, piece, k)
        for lane, (left, right) in enumerate(_LANES):
            _add_lanelet(street, piece, lane, border_id(piece, left), border_id(piece, right))
    for number, block in enumerate(blocks):
        _add_signals(street, world, pieces, number, block)
    return street


def write_map(street: StreetMap, path: Path) -> None:
    """Write a map as OSM XML, with the points that its line strings have."""
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
    used = {node for nodes, _ in street.ways.values() for node in nodes}
    for identity, point in street.nodes.items():
        if identity not in used:
            continue
        latitude, longitude, altitude = origin.geodetic(np.array(point))
        node = ET.SubElement(
            root, "node", id=str(identity), lat=f"{latitude:.11f}", lon=f"{longitude:.11f}"
        )
        local = {"local_x": f"{point[0]:.6f}", "local_y": f"{point[1]:.6f}"}
        own = street.node_tags.get(identity, {})
        _add_tags(node, {**local, "ele": f"{altitude:.6f}", **own})
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


def _add_border(street: StreetMap, world: World, piece: Piece, k: int) -> None:
    border = BORDERS[k]
    xs = np.array([piece.start_m, piece.end_m])
    zs = world.profile.height(xs) + border.height_m
    points = [(float(x), border.y_m, float(z)) for x, z in zip(xs, zs, strict=True)]
    street.way(border_id(piece, k), points, dict(border.tags))


def _lanelet_id(piece: Piece, lane: int) -> int:
    return 500_000 + 10 * piece.number + lane


def _add_lanelet(street: StreetMap, piece: Piece, lane: int, left: int, right: int) -> None:
    members = [("way", "left", left), ("way", "right", right)]
    tags = {
        "type": "lanelet",
        "subtype": "road",
        "location": "urban",
        "one_way": "yes",
        "speed_limit": str(_SPEED_LIMIT_KMH),
        "participant:vehicle": "yes",
    }
    street.relations[_lanelet_id(piece, lane)] = (members, tags)


def _add_signals(
    street: StreetMap, world: World, pieces: list[Piece], number: int, block: int
) -> None:
    """Add stop lines, heads and rules; the lanes before a stop line obey its heads."""
    content = block_at(world.seed, block)
    for west, stop in enumerate(content.stop_lines):
        rule = signal_rule_id(number, towards_west=bool(west))
        line = _add_stop_line(street, world, stop_line_id(number, towards_west=bool(west)), stop)
        street.relations[rule] = (
            [("way", "ref_line", line)],
            {"type": "regulatory_element", "subtype": "traffic_light"},
        )
        for signal in content.signals:
            if (signal.head.yaw_rad < 0) == west:
                add_head(street, world, rule, signal.head)
        before = [p for p in pieces if (p.start_m if west else p.end_m) == stop.near_x_m]
        for piece in before:
            for lane in (2, 3) if west else (0, 1):
                obeying = street.relations[_lanelet_id(piece, lane)]
                obeying[0].append(("relation", "regulatory_element", rule))


def _add_stop_line(street: StreetMap, world: World, identity: int, stop: StopLine) -> int:
    z = float(world.profile.height(stop.near_x_m))
    points = [(stop.near_x_m, y, z) for y in stop.y_range_m]
    width = abs(stop.far_x_m - stop.near_x_m)
    return street.way(identity, points, {"type": "stop_line", "width": f"{width:.2f}"})


def add_head(street: StreetMap, world: World, rule: int, head: Placed) -> None:
    """Add a signal head and its lamps to a map, and to the rule that they belong to.

    A head is the lower edge of its face, from left to right for who looks at it; its lamps are
    a line string of points, as Autoware has them.

    Args:
        street: The map.
        world: The street that it is of.
        rule: The regulatory element.
        head: The head; `object_id` is the id that it gets in the map.
    """
    T_map_head = world.place(head, 0.0)
    edge = [(x, _SIGNAL_FACE_M, 0.0) for x in (_SIGNAL_HALF_WIDTH_M, -_SIGNAL_HALF_WIDTH_M)]
    tags = {
        "type": "traffic_light",
        "subtype": "red_yellow_green",
        "height": f"{_SIGNAL_HEIGHT_M:.2f}",
    }
    street.way(head.object_id, _placed(edge, T_map_head), tags)
    lamps = [(0.0, _SIGNAL_FACE_M, z) for z in signal_lamps()]
    bulbs = street.way(
        head.object_id + _BULBS,
        _placed(lamps, T_map_head),
        {"type": "light_bulbs", "traffic_light_id": str(head.object_id)},
    )
    for node, colour in zip(street.ways[bulbs][0], LAMPS, strict=True):
        street.node_tags[node] = {"color": colour}
    members = street.relations[rule][0]
    members += [("way", "refers", head.object_id), ("way", "light_bulbs", bulbs)]


def _placed(points: list[Point], T_map_head: NDArray[np.float64]) -> list[Point]:
    placed = np.array(points) @ T_map_head[:3, :3].T + T_map_head[:3, 3]
    return [(float(x), float(y), float(z)) for x, y, z in placed]
