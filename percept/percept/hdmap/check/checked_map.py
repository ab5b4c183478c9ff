"""A map as rules look at it: by type, by who refers to what, and by where things lie."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from percept.hdmap.check.surface import surface_height_m
from percept.hdmap.elements import Lanelet, RegulatoryElement
from percept.hdmap.map import HdMap
from percept.hdmap.routing import RoutingGraph, make_routing

__all__ = ["CheckedMap", "sound"]

# Borders that should be one and are two cross each other by slivers.
_LEAST_OVERLAP_M2 = 1e-3
# What lies further above passes over: a bridge, as Lanelet2's routing graph takes it.
_CLEARANCE_M = 2.0


class CheckedMap:
    """A map with the indices that rules need; each is made when it is first asked for.

    All shapes are seen from above, in the map frame, metres. No lookup fails for ids that the
    map lacks: a member of a regulatory element may stand for nothing.

    Attributes:
        hd_map: The map itself. Its `lanelets` are those with two whole borders, turned in driving
            direction; its `routing` is that of vehicles.
    """

    def __init__(self, hd_map: HdMap) -> None:
        self.hd_map = hd_map
        self._conflicting: dict[int, tuple[int, ...]] = {}

    @cached_property
    def routing(self) -> RoutingGraph:
        """How all lanelets hang together, whoever may use them, in the direction of borders."""
        return make_routing(self.hd_map.lanelets, self.hd_map.line_strings, None)

    @cached_property
    def footways(self) -> RoutingGraph:
        """How the lanelets that people may walk on hang together, in both directions."""
        return make_routing(self.hd_map.lanelets, self.hd_map.line_strings, "pedestrian")

    def ways_of(self, *types: str) -> tuple[int, ...]:
        """Return line strings and polygons by the tag `type`, ids rising."""
        return tuple(sorted(i for kind in types for i in self._ways_by_type.get(kind, ())))

    def lanelets_of(self, *subtypes: str) -> tuple[Lanelet, ...]:
        """Return lanelets of subtypes, ids rising."""
        lanelets = self.hd_map.lanelets
        return tuple(lanelets[i] for i in sorted(lanelets) if lanelets[i].subtype in subtypes)

    def rules_of(self, *subtypes: str) -> tuple[RegulatoryElement, ...]:
        """Return regulatory elements of subtypes, ids rising."""
        rules = self.hd_map.rules
        return tuple(rules[i] for i in sorted(rules) if rules[i].subtype in subtypes)

    def way_tags(self, way_id: int) -> Mapping[str, str]:
        """Return the tags of a line string or polygon; none of one that is not there."""
        way = self.hd_map.line_strings.get(way_id)
        return {} if way is None else way.tags

    def ways_in(self, rule: RegulatoryElement, role: str) -> tuple[int, ...]:
        """Return members of a role that are line strings or polygons of the map, in order."""
        return tuple(i for i in rule.ids(role, "way") if i in self.hd_map.line_strings)

    def lanelets_in(self, rule: RegulatoryElement, role: str) -> tuple[int, ...]:
        """Return members of a role that are lanelets of the map, in order."""
        return tuple(i for i in rule.ids(role, "relation") if i in self.hd_map.lanelets)

    def rules_about(self, kind: str, ref: int) -> tuple[RegulatoryElement, ...]:
        """Return regulatory elements with a member, in any role, ids rising.

        Args:
            kind: `node`, `way` or `relation`.
            ref: Its id.
        """
        return self._rules_about.get((kind, ref), ())

    def is_referred(self, way_id: int, *, by: str) -> bool:
        """Return whether a regulatory element of the subtype `by` refers to a way."""
        return any(
            rule.subtype == by and way_id in rule.ids("refers", "way")
            for rule in self.rules_about("way", way_id)
        )

    def rules_for(self, lanelet: Lanelet, *subtypes: str) -> tuple[RegulatoryElement, ...]:
        """Return regulatory elements of subtypes that a lanelet names as holding for it."""
        rules = (self.hd_map.rules.get(i) for i in lanelet.rule_ids)
        return tuple(rule for rule in rules if rule is not None and rule.subtype in subtypes)

    def lanelets_under(self, rule_id: int) -> tuple[int, ...]:
        """Return the lanelets that name a regulatory element as holding for them, ids rising."""
        return self._lanelets_under.get(rule_id, ())

    def line(self, way_id: int) -> LineString | None:
        """Return a line string; None of one that is not there or has less than two points."""
        if way_id not in self.hd_map.line_strings:
            return None
        points = self.hd_map.points_of(way_id)
        return LineString(points[:, :2]) if len(points) > 1 else None

    def outline(self, way_id: int) -> Polygon | None:
        """Return a polygon as it is drawn, which may cross itself; None with less than 3 points."""
        if way_id not in self.hd_map.line_strings:
            return None
        points = self.hd_map.points_of(way_id)
        return Polygon(points[:, :2]) if len(points) > 2 else None

    def ground(self, way_id: int) -> BaseGeometry:
        """Return what a polygon covers: sound for every operation, empty where there is none."""
        outline = self.outline(way_id)
        return Polygon() if outline is None else sound(outline)

    def lanelet_ground(self, lanelet_id: int) -> BaseGeometry:
        """Return what a lanelet covers: sound for every operation, empty where there is none."""
        return self._lanelet_grounds.get(lanelet_id, Polygon())

    def borders(self, lanelet_id: int) -> tuple[LineString, LineString]:
        """Return the left and the right border of a lanelet that is there."""
        return self._borders[lanelet_id]

    def lanelets_near(self, shape: BaseGeometry, margin_m: float = 0.0) -> tuple[int, ...]:
        """Return lanelets whose boxes touch the box of a shape widened by a margin, ids rising."""
        if shape.is_empty or not self._lanelet_ids:
            return ()
        x0, y0, x1, y1 = shape.bounds
        box = shapely.box(x0 - margin_m, y0 - margin_m, x1 + margin_m, y1 + margin_m)
        return tuple(sorted(self._lanelet_ids[row] for row in self._lanelet_tree.query(box)))

    def conflicting(self, lanelet_id: int) -> tuple[int, ...]:
        """Return lanelets that cover ground that a lanelet covers too, ids rising.

        One over the other, as on a bridge, do not; nor do two that share only a line.
        """
        if lanelet_id not in self._conflicting:
            self._conflicting[lanelet_id] = tuple(self._find_conflicting(lanelet_id))
        return self._conflicting[lanelet_id]

    def _find_conflicting(self, lanelet_id: int) -> Iterator[int]:
        ground = self.lanelet_ground(lanelet_id)
        others = [i for i in self.lanelets_near(ground) if i != lanelet_id]
        grounds = np.array([self.lanelet_ground(i) for i in others], dtype=object)
        common = shapely.intersection(ground, grounds)
        for other_id, shape, area_m2 in zip(others, common, shapely.area(common), strict=True):
            if area_m2 > _LEAST_OVERLAP_M2 and self._same_level(lanelet_id, other_id, shape):
                yield other_id

    def _same_level(self, one_id: int, other_id: int, common: BaseGeometry) -> bool:
        place = np.array(common.representative_point().coords[0])
        heights_m = [surface_height_m(self.hd_map.lanelets[i], place) for i in (one_id, other_id)]
        return abs(heights_m[0] - heights_m[1]) < _CLEARANCE_M

    @cached_property
    def _ways_by_type(self) -> Mapping[str, Sequence[int]]:
        by_type = defaultdict(list)
        for way_id, way in self.hd_map.line_strings.items():
            by_type[way.tags.get("type", "")].append(way_id)
        return by_type

    @cached_property
    def _rules_about(self) -> Mapping[tuple[str, int], tuple[RegulatoryElement, ...]]:
        about: defaultdict[tuple[str, int], dict[int, RegulatoryElement]] = defaultdict(dict)
        for rule_id in sorted(self.hd_map.rules):
            rule = self.hd_map.rules[rule_id]
            for member in rule.members:
                about[member.kind, member.ref][rule_id] = rule
        return {member: tuple(rules.values()) for member, rules in about.items()}

    @cached_property
    def _lanelets_under(self) -> Mapping[int, tuple[int, ...]]:
        under: defaultdict[int, dict[int, None]] = defaultdict(dict)
        for lanelet_id in sorted(self.hd_map.lanelets):
            for rule_id in self.hd_map.lanelets[lanelet_id].rule_ids:
                under[rule_id][lanelet_id] = None
        return {rule_id: tuple(lanelets) for rule_id, lanelets in under.items()}

    @cached_property
    def _lanelet_ids(self) -> Sequence[int]:
        return sorted(self.hd_map.lanelets)

    @cached_property
    def _lanelet_grounds(self) -> Mapping[int, BaseGeometry]:
        lanelets = (self.hd_map.lanelets[i] for i in self._lanelet_ids)
        return {lanelet.lanelet_id: sound(_lanelet_outline(lanelet)) for lanelet in lanelets}

    @cached_property
    def _borders(self) -> Mapping[int, tuple[LineString, LineString]]:
        return {
            i: (LineString(lanelet.left_map[:, :2]), LineString(lanelet.right_map[:, :2]))
            for i, lanelet in self.hd_map.lanelets.items()
        }

    @cached_property
    def _lanelet_tree(self) -> shapely.STRtree:
        return shapely.STRtree([self._lanelet_grounds[i] for i in self._lanelet_ids])


def sound(shape: BaseGeometry) -> BaseGeometry:
    """Return a shape that covers the same and that every operation takes."""
    return shape if shape.is_valid else shapely.make_valid(shape)


def _lanelet_outline(lanelet: Lanelet) -> Polygon:
    """Return the left border forth and the right one back; at least 4 points."""
    return Polygon(np.concatenate([lanelet.left_map[:, :2], lanelet.right_map[::-1, :2]]))
