"""Line strings of a map that stand for paint, or for an edge where nobody paints.

Words and defaults are those of Lanelet2's LinestringTagging: `line_thin` and `line_thick` are
paint along the road; `virtual`, `road_border`, `curbstone` and other things that one can run into
are not painted; a painted line without the tag `color` is white (`unknown` is only said of what
is not painted, and of a tag that is there and empty). `stop_line` is one, and so is any line
string that a rule about stopping has as its `ref_line`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import LINE_TYPES
from percept.hdmap.elements import Lanelet, MapMarking, RegulatoryElement
from percept.hdmap.osm import OsmWay

__all__ = ["map_markings"]

_F64 = NDArray[np.float64]

_PAINTED_LINES = frozenset({"line_thin", "line_thick", "bike_marking"})
_CROSSWALK_PAINT = frozenset({"pedestrian_marking", "zebra_marking"})
_UNPAINTED_LINES = frozenset(
    {
        *("virtual", "road_border", "curbstone", "guard_rail", "wall", "fence", "jersey_barrier"),
        *("gate", "door", "rail", "keepout"),
    }
)
_NO_LINES = frozenset(
    {
        *("traffic_light", "light_bulbs", "traffic_sign", "arrow", "symbol", "zig-zag", "bump"),
        *("lift_gate", "bus_stop_area", "detection_area", "no_stopping_area", "no_parking_area"),
        *("intersection_area", "intersection_coordination", "hatched_road_markings", "crosswalk"),
        *("parking_lot", "parking_space", "obstacle_removal_area", "start_line", "centerline"),
        *("crosswalk_polygon", "building", "speed_bump", "pole", "waypoints", "yield_line"),
    }
)
# A ref_line of these is where one stops; of a speed limit it is where the limit begins.
_STOPPING = frozenset(
    {
        *("traffic_light", "right_of_way", "crosswalk", "all_way_stop", "road_marking"),
        *("detection_area", "no_stopping_area", "virtual_traffic_light"),
    }
)
_SPEED_SIGNS = ("speed_limit", "274")


def map_markings(
    ways: Mapping[int, OsmWay],
    lanelets: Mapping[int, Lanelet],
    rules: Mapping[int, RegulatoryElement],
    shapes: Mapping[int, _F64],
    dropped: Counter[str],
) -> tuple[MapMarking, ...]:
    """Return the markings of a map by the ids of their line strings, rising.

    Args:
        ways: Line strings and polygons whose points are all there.
        lanelets: Lanelets, whose borders may lack a type.
        rules: Regulatory elements, of which `ref_line` makes stop lines.
        shapes: Points (K, 3) of these line strings in the map frame.
        dropped: Takes line strings of types that are not known, by type.
    """
    stops = _stop_lines(ways, rules)
    borders, crossings = _borders(lanelets)
    inner = {lanelet.centreline_id for lanelet in lanelets.values()}
    markings = []
    for identity in sorted(ways):
        way = ways[identity]
        kind = _kind(identity, way, stops, crossings)
        word = way.tags.get("type", "")
        if kind is None and identity not in inner and word not in _NO_LINES:
            dropped[_not_known(word)] += 1
            kind = "line" if identity in borders else None
        if kind is not None and len(way.nodes) > 1:
            markings.append(_marking(identity, kind, way, shapes[identity]))
    return tuple(markings)


def _stop_lines(ways: Mapping[int, OsmWay], rules: Mapping[int, RegulatoryElement]) -> set[int]:
    stops = {i for i, way in ways.items() if way.tags.get("type") == "stop_line"}
    for rule in rules.values():
        if rule.subtype in _STOPPING or (
            rule.subtype == "traffic_sign" and not _limits_speed(rule, ways)
        ):
            stops.update(rule.ids("ref_line", "way"))
    return stops


def _limits_speed(rule: RegulatoryElement, ways: Mapping[int, OsmWay]) -> bool:
    words = [rule.tags.get("sign_type", "")]
    words += [ways[i].tags.get("subtype", "") for i in rule.ids("refers", "way") if i in ways]
    return any(mark in word for word in words for mark in _SPEED_SIGNS)


def _borders(lanelets: Mapping[int, Lanelet]) -> tuple[set[int], set[int]]:
    """Return line strings that bound lanelets, and those that bound only crosswalks."""
    borders: set[int] = set()
    crossings: set[int] = set()
    for lanelet in lanelets.values():
        of_both = (*lanelet.left_ids, *lanelet.right_ids)
        (crossings if lanelet.subtype == "crosswalk" else borders).update(of_both)
    return borders | crossings, crossings - borders


def _kind(identity: int, way: OsmWay, stops: set[int], crossings: set[int]) -> str | None:
    word = way.tags.get("type", "")
    if identity in stops and word not in _NO_LINES:
        return "stop_line"
    if word in _CROSSWALK_PAINT or (identity in crossings and word in _PAINTED_LINES):
        return "crosswalk"
    return "line" if word in _PAINTED_LINES or word in _UNPAINTED_LINES else None


def _not_known(word: str) -> str:
    """Return why a line string is taken as not painted; only as a border it is a marking."""
    said = f"of the type '{word[:40]}', which is not known" if word else "without a type"
    return f"line strings {said}, taken as not painted"


def _marking(identity: int, kind: str, way: OsmWay, points_map: _F64) -> MapMarking:
    painted = way.tags.get("type") in _PAINTED_LINES | _CROSSWALK_PAINT | {"stop_line"}
    subtype = way.tags.get("subtype", "")
    return MapMarking(
        element_id=identity,
        kind=kind,
        points_map=points_map,
        type=subtype if painted and subtype in LINE_TYPES else "unknown",
        colour=(way.tags.get("color", "white") or "unknown") if painted else "unknown",
        painted=painted and subtype != "virtual",
        width_m=_width(way.tags.get("width", "")),
        name=f"way {identity}",
    )


def _width(text: str) -> float:
    try:
        width = float(text)
    except ValueError:
        return math.nan
    return width if math.isfinite(width) and width > 0 else math.nan
