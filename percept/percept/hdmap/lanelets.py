"""Lanelets and areas of a map, from its relations: borders joined and turned as they are driven.

A border is one line string or several that share end points. As Lanelet2 does
(`geometry::align`), the right border is taken to lie right of the left one, and both are turned
so that they do: the order of points in the file says nothing of the driving direction.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.elements import Lanelet, MapArea
from percept.hdmap.osm import OsmRelation, OsmWay
from percept.hdmap.sides import aligned

__all__ = ["map_areas", "map_lanelets"]

_F64 = NDArray[np.float64]
_NO_BORDER = "lanelets without a whole left and right border"
_BROKEN_BORDER = "lanelets with a border whose line strings do not join"
_NO_OUTLINE = "areas without a closed outline"
_AREA_TYPES = ("multipolygon", "area")


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """Line strings that follow each other: their ids, the ids of their points, and the points."""

    ids: tuple[int, ...]
    nodes: tuple[int, ...]
    points_map: _F64

    def turned(self) -> _Chain:
        """Return it backwards."""
        return _Chain(self.ids[::-1], self.nodes[::-1], self.points_map[::-1])

    def joined(self, other: _Chain) -> _Chain | None:
        """Return both as one where they share an end point, as this one runs."""
        for piece in (other, other.turned()):
            for first, second in ((self, piece), (piece, self)):
                if first.nodes[-1] == second.nodes[0]:
                    return _Chain(
                        first.ids + second.ids,
                        first.nodes + second.nodes[1:],
                        np.concatenate([first.points_map, second.points_map[1:]]),
                    )
        return None


def map_lanelets(
    ways: Mapping[int, OsmWay],
    relations: Mapping[int, OsmRelation],
    shapes: Mapping[int, _F64],
    dropped: Counter[str],
) -> dict[int, Lanelet]:
    """Return the lanelets of a map by id.

    Args:
        ways: Line strings whose points are all there.
        relations: Lanelets, among others.
        shapes: Points (K, 3) of these line strings in the map frame.
        dropped: Takes the lanelets that have no borders, by reason.
    """
    lanelets = {}
    for identity, relation in relations.items():
        if relation.tags.get("type") == "lanelet":
            lanelet = _lanelet(identity, relation, ways, shapes, dropped)
            if lanelet is not None:
                lanelets[identity] = lanelet
    return lanelets


def _lanelet(
    identity: int,
    relation: OsmRelation,
    ways: Mapping[int, OsmWay],
    shapes: Mapping[int, _F64],
    dropped: Counter[str],
) -> Lanelet | None:
    sides = [_way_ids(relation, role) for role in ("left", "right")]
    if not all(side and all(i in ways and len(ways[i].nodes) > 1 for i in side) for side in sides):
        dropped[_NO_BORDER] += 1
        return None
    left, right = (_joined(side, ways, shapes) for side in sides)
    if left is None or right is None:
        dropped[_BROKEN_BORDER] += 1
        return None
    turn_left, turn_right = aligned(left.points_map, right.points_map)
    left = left.turned() if turn_left else left
    right = right.turned() if turn_right else right
    centrelines = _way_ids(relation, "centerline")
    return Lanelet(
        lanelet_id=identity,
        tags=relation.tags,
        left_ids=left.ids,
        right_ids=right.ids,
        left_map=left.points_map,
        right_map=right.points_map,
        centreline_id=centrelines[0] if centrelines and centrelines[0] in ways else 0,
        rule_ids=_rule_ids(relation),
        left_nodes=left.nodes,
        right_nodes=right.nodes,
    )


def map_areas(
    ways: Mapping[int, OsmWay],
    relations: Mapping[int, OsmRelation],
    shapes: Mapping[int, _F64],
    dropped: Counter[str],
) -> dict[int, MapArea]:
    """Return the areas of a map by id; arguments as of `map_lanelets`."""
    areas = {}
    for identity, relation in relations.items():
        if relation.tags.get("type") not in _AREA_TYPES:
            continue
        outer = _way_ids(relation, "outer")
        whole = bool(outer) and all(i in ways and ways[i].nodes for i in outer)
        ring = _joined(outer, ways, shapes) if whole else None
        if ring is None or len(ring.nodes) < 4 or ring.nodes[0] != ring.nodes[-1]:
            dropped[_NO_OUTLINE] += 1
            continue
        areas[identity] = MapArea(
            area_id=identity,
            tags=relation.tags,
            outer_ids=ring.ids,
            outer_map=ring.points_map[:-1],
            inner_ids=tuple(i for i in _way_ids(relation, "inner") if i in ways),
            rule_ids=_rule_ids(relation),
        )
    return areas


def _way_ids(relation: OsmRelation, role: str) -> tuple[int, ...]:
    return tuple(m.ref for m in relation.members if m.role == role and m.kind == "way")


def _rule_ids(relation: OsmRelation) -> tuple[int, ...]:
    return tuple(m.ref for m in relation.members if m.role == "regulatory_element")


def _joined(
    ids: Sequence[int], ways: Mapping[int, OsmWay], shapes: Mapping[int, _F64]
) -> _Chain | None:
    """Return line strings joined where they share end points; None if they do not."""
    chain, *rest = [_Chain((i,), ways[i].nodes, shapes[i]) for i in ids]
    while rest:
        for piece in rest:
            joined = chain.joined(piece)
            if joined is not None:
                chain = joined
                rest.remove(piece)
                break
        else:
            return None
    return chain
