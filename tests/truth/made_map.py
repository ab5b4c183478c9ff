"""Lanelet2 maps made point by point, for rules that they keep or break."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from made_osm import node, relation, way, write_osm

from percept.hdmap import HdMap, load_map

__all__ = ["ROAD", "MadeMap"]

ROAD = {"subtype": "road", "location": "urban", "one_way": "yes", "speed_limit": "30"}
Member = tuple[str, str, int]  # kind, role, id


class MadeMap:
    """A map that grows; ids rise from 1 over all kinds of elements."""

    def __init__(self) -> None:
        self._elements: list[str] = []
        self._points: dict[tuple[float, float, float], int] = {}

    @property
    def next_id(self) -> int:
        """The id that the next element takes."""
        return len(self._elements) + 1

    def _add(self, element: str) -> int:
        self._elements.append(element)
        return len(self._elements)

    def point(self, x: float, y: float, z: float = 0.0, **tags: str) -> int:
        """Return the point at a place: the same one for the same place, unless it has tags."""
        place = (x, y, z)
        if tags or place not in self._points:
            identity = self._add(node(self.next_id, x, y, z, **tags))
            self._points.setdefault(place, identity)
            return identity
        return self._points[place]

    def line(self, *places: tuple[float, ...], **tags: str) -> int:
        """Add a line string through places."""
        nodes = [self.point(*place) for place in places]
        words = {"type": "line_thin", "subtype": "solid", **tags}
        return self._add(way(self.next_id, nodes, **words))

    def lanelet(
        self,
        left: int,
        right: int,
        rules: Sequence[int] = (),
        centreline: int | None = None,
        /,
        **tags: str,
    ) -> int:
        """Add a lanelet between two line strings; a road unless tags say otherwise."""
        members = [("way", "left", left), ("way", "right", right)]
        members += [("relation", "regulatory_element", rule) for rule in rules]
        if centreline is not None:
            members.append(("way", "centerline", centreline))
        return self.relation(members, **{"type": "lanelet", **(tags or ROAD)})

    def rule(self, subtype: str, *members: Member) -> int:
        """Add a regulatory element with members."""
        return self.relation(members, type="regulatory_element", subtype=subtype)

    def relation(self, members: Sequence[Member], **tags: str) -> int:
        """Add a relation with members; they may be missing."""
        return self._add(relation(self.next_id, members, **tags))

    def lane(self, x0: float, x1: float, y0: float, y1: float, **tags: str) -> int:
        """Add a straight lanelet along +x from x0 to x1 between y0 and y1, y0 < y1."""
        left, right = (self.line((x0, y), (x1, y), lane_change="no") for y in (y1, y0))
        return self.lanelet(left, right, (), None, **tags)

    def written(self, folder: Path) -> Path:
        """Write the map and return its file."""
        return write_osm(folder / "map.osm", *self._elements)

    def loaded(self, folder: Path) -> HdMap:
        """Write the map and read it."""
        return load_map(self.written(folder), anywhere=True)
