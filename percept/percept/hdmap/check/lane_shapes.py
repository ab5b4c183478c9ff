"""Rules on the shapes of lanelets and of their centre lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely
from numpy.typing import NDArray

from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.check.issue import IssueCode, MapIssue, listed
from percept.hdmap.check.rule import Rule
from percept.hdmap.check.surface import surface_height_m
from percept.hdmap.elements import Lanelet

__all__ = ["CENTERLINE_GEOMETRY", "LANELET_GEOMETRY"]

_F64 = NDArray[np.float64]
# How far a point may lie outside, and over or under the surface, and still be on it.
_PLANAR_TOLERANCE_M = 0.01
_HEIGHT_TOLERANCE_M = 0.1

_LANELET = "mapping.lane.lanelet_geometry"
_SHARED_POINT = IssueCode(
    "Lane.LaneletGeometry-001", _LANELET, "Error", "lanelet",
    "Draw its two borders with points of their own",
)  # fmt: skip

_CENTRELINE = "mapping.lane.centerline_geometry"
_LOOSE_END = IssueCode(
    "Lane.CenterlineGeometry-001", _CENTRELINE, "Error", "linestring",
    "Let the centre line begin and end on the lines between the ends of the two borders",
)  # fmt: skip
_OUTSIDE = IssueCode(
    "Lane.CenterlineGeometry-002", _CENTRELINE, "Error", "linestring",
    "Move the points into the lanelet",
)  # fmt: skip
_OFF_SURFACE = IssueCode(
    "Lane.CenterlineGeometry-003", _CENTRELINE, "Error", "linestring",
    "Correct the heights (ele) of the points",
)  # fmt: skip


def _lanelet_geometry(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet_id, lanelet in checked.hd_map.lanelets.items():
        shared = set(lanelet.left_nodes) & set(lanelet.right_nodes)
        if shared:
            yield _SHARED_POINT.at(
                lanelet_id, f"has points in both of its borders ({listed(sorted(shared))})"
            )


def _centerline_geometry(checked: CheckedMap) -> Iterator[MapIssue]:
    for lanelet in checked.hd_map.lanelets.values():
        if lanelet.centreline_id in checked.hd_map.line_strings:
            yield from _centreline_of(checked, lanelet)


def _centreline_of(checked: CheckedMap, lanelet: Lanelet) -> Iterator[MapIssue]:
    line_id = lanelet.centreline_id
    of = f"(centre line of lanelet {lanelet.lanelet_id})"
    nodes = checked.hd_map.line_strings[line_id].nodes
    points = checked.hd_map.points_of(line_id)
    for row in (0, -1):
        edge = shapely.LineString([lanelet.left_map[row, :2], lanelet.right_map[row, :2]])
        off_m = edge.distance(shapely.Point(points[row, :2]))
        if off_m > _PLANAR_TOLERANCE_M:
            end = "begins" if row == 0 else "ends"
            yield _LOOSE_END.at(
                line_id, f"{of} {end} at point {nodes[row]}, {off_m:.2f} m off the lanelet's edge"
            )
    outside = _far_outside(checked, lanelet.lanelet_id, points)
    if outside[1:-1].any():
        ids = [nodes[row] for row in range(1, len(nodes) - 1) if outside[row]]
        yield _OUTSIDE.at(line_id, f"{of} has points outside of the lanelet ({listed(ids)})")
    heights = [surface_height_m(lanelet, point[:2]) for point in points]
    off_surface = np.abs(points[:, 2] - heights) > _HEIGHT_TOLERANCE_M
    if off_surface.any():
        ids = [node for node, off in zip(nodes, off_surface, strict=True) if off]
        yield _OFF_SURFACE.at(
            line_id,
            f"{of} has points over {_HEIGHT_TOLERANCE_M:g} m above or below the lanelet "
            f"({listed(ids)})",
        )


def _far_outside(checked: CheckedMap, lanelet_id: int, points: _F64) -> NDArray[np.bool_]:
    ground = checked.lanelet_ground(lanelet_id)
    off_m: _F64 = shapely.distance(ground, shapely.points(points[:, :2]))
    return off_m > _PLANAR_TOLERANCE_M


LANELET_GEOMETRY = Rule(
    name=_LANELET,
    looks_for="Lanelets whose left and right borders have points in common",
    codes=(_SHARED_POINT,),
    find=_lanelet_geometry,
)
CENTERLINE_GEOMETRY = Rule(
    name=_CENTRELINE,
    looks_for="Centre lines that leave their lanelet, or end away from its edges",
    codes=(_LOOSE_END, _OUTSIDE, _OFF_SURFACE),
    find=_centerline_geometry,
)
