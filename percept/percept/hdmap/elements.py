"""What a map says of the road, apart from the file that it stands in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.polyline import length_m

__all__ = ["Lanelet", "MapArea", "MapMarking", "Member", "RegulatoryElement"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Member:
    """A member of a regulatory element.

    Attributes:
        kind: `node`, `way` or `relation`, as in the file; it may be missing there.
        role: `refers`, `ref_line`, `yield`, `right_of_way`, `cancels`, or another of the map.
        ref: Its id.
    """

    kind: str
    role: str
    ref: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapMarking:
    """A line or bar of the map that road and map can be compared by.

    Attributes:
        element_id: The line string's id; for OpenDRIVE a number of its own.
        kind: `line` (along the road), `stop_line` or `crosswalk`.
        points_map: (K, 3) float64 in the map frame, metres: the middle of a line's paint, the
            near edge of a stop line, the outline or middle line of a crosswalk.
        type: `solid`, `dashed`, `solid_solid`, `solid_dashed`, `dashed_solid` or `unknown`; of a
            pair the first word is the line on the left in the direction of the points.
        colour: `white`, `yellow`, another word of the map, or `unknown`.
        painted: False for kerbs, road edges, guard rails and virtual lines, which nobody paints.
        width_m: Width of the paint along the road for stop lines, across it for lines; NaN
            where the map does not say.
        name: What people call it, such as `way 123` or `road 4 lane -1`.
    """

    element_id: int
    kind: str
    points_map: _F64
    type: str
    colour: str
    painted: bool
    width_m: float
    name: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Lanelet:
    """A piece of a lane between two borders.

    Attributes:
        lanelet_id: The relation's id.
        tags: All of its tags.
        left_ids: Line strings of its left border, in driving direction; usually one.
        right_ids: The same of its right border.
        left_map: (K, 3) float64 points of the left border in driving direction, map frame.
        right_map: (M, 3) float64 points of the right border in driving direction.
        centreline_id: Line string of the centre line, or 0 where the map has none.
        rule_ids: Its regulatory elements.
        left_nodes: (K,) ids of the points of the left border.
        right_nodes: (M,) ids of the points of the right border.
    """

    lanelet_id: int
    tags: Mapping[str, str]
    left_ids: tuple[int, ...]
    right_ids: tuple[int, ...]
    left_map: _F64
    right_map: _F64
    centreline_id: int
    rule_ids: tuple[int, ...]
    left_nodes: tuple[int, ...] = ()
    right_nodes: tuple[int, ...] = ()

    @property
    def subtype(self) -> str:
        """Its subtype, such as `road` or `crosswalk`; empty without one."""
        return self.tags.get("subtype", "")

    @property
    def length_m(self) -> float:
        """Mean length of its two borders in space."""
        return (length_m(self.left_map) + length_m(self.right_map)) / 2


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapArea:
    """A piece of ground that is crossed in any direction: a Lanelet2 area (multipolygon).

    Attributes:
        area_id: The relation's id.
        tags: All of its tags.
        outer_ids: Line strings of its outline, in the order that they join.
        outer_map: (K, 3) float64 points of its outline, map frame, not closed.
        inner_ids: Line strings of its holes.
        rule_ids: Its regulatory elements.
    """

    area_id: int
    tags: Mapping[str, str]
    outer_ids: tuple[int, ...]
    outer_map: _F64
    inner_ids: tuple[int, ...]
    rule_ids: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RegulatoryElement:
    """A rule of the road and what it is about.

    Attributes:
        rule_id: The relation's id.
        subtype: Such as `traffic_light`, `right_of_way`, `traffic_sign`; empty without one.
        tags: All of its tags.
        members: Its members in the order of the file, whether the file holds them or not.
    """

    rule_id: int
    subtype: str
    tags: Mapping[str, str]
    members: tuple[Member, ...]

    def ids(self, role: str, kind: str | None = None) -> tuple[int, ...]:
        """Return the ids of members with a role, and of a kind if one is given."""
        return tuple(m.ref for m in self.members if m.role == role and kind in (None, m.kind))

    @property
    def by_role(self) -> Mapping[str, tuple[Member, ...]]:
        """Its members by role."""
        roles = dict.fromkeys(member.role for member in self.members)
        return {role: tuple(m for m in self.members if m.role == role) for role in roles}
