"""Where the lines of a virtual traffic light lie: on which lanelets, how far along the way."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point

from percept.core.polyline import length_m
from percept.hdmap.check.checked_map import CheckedMap
from percept.hdmap.elements import RegulatoryElement

__all__ = ["Track", "end_line_on", "lanelets_below", "path_between", "share_on"]

_F64 = NDArray[np.float64]
_AS_GOOD = 0.9
"""Where lanelets overlap, those count that cover nearly as much of a line as the best."""


def share_on(line: LineString, ground: shapely.Geometry) -> float:
    """Return how much of a line lies on ground, 0 to 1."""
    return float(line.intersection(ground).length / line.length) if line.length else 0.0


def lanelets_below(checked: CheckedMap, line: LineString) -> tuple[int, ...]:
    """Return the lanelets for vehicles that a line lies on: those with the most of it, that first.

    Empty for a line that lies on none.
    """
    drivable = checked.hd_map.routing.left
    shares = {
        lanelet: share_on(line, checked.lanelet_ground(lanelet))
        for lanelet in checked.lanelets_near(line)
        if lanelet in drivable
    }
    least = _AS_GOOD * max(shares.values(), default=0.0)
    best = [lanelet for lanelet, share in shares.items() if share > 0 and share >= least]
    return tuple(sorted(best, key=lambda lanelet: (-shares[lanelet], lanelet)))


def end_line_on(checked: CheckedMap, rule: RegulatoryElement, lanelet_id: int) -> int | None:
    """Return the end line of a virtual traffic light that lies most on a lanelet; None of none."""
    ground = checked.lanelet_ground(lanelet_id)
    shares = {
        way: share_on(line, ground)
        for way in checked.ways_in(rule, "end_line")
        if (line := checked.line(way)) is not None
    }
    best = max(shares, key=lambda way: shares[way], default=None)
    return best if best is not None and shares[best] > 0 else None


def path_between(checked: CheckedMap, starts: Sequence[int], end: int) -> tuple[int, ...]:
    """Return the lanelets of the shortest way to a lanelet, without lane changes, both ends in it.

    Args:
        checked: The map.
        starts: Where the way may begin; the first from which there is a way is taken.
        end: Where it ends.

    Returns:
        Lanelets in driving order; empty if there is no way.
    """
    for start in starts:
        path = _shortest(checked, start, end)
        if path:
            return path
    return ()


def _shortest(checked: CheckedMap, start: int, end: int) -> tuple[int, ...]:
    """Return the shortest way between two lanelets (Dijkstra, Numerische Mathematik 1, 1959)."""
    lanelets, routing = checked.hd_map.lanelets, checked.hd_map.routing
    came_from: dict[int, int] = {}
    ahead = [(0.0, start, start)]
    while ahead:
        length, current, before = heapq.heappop(ahead)
        if current in came_from:
            continue
        came_from[current] = before
        if current == end:
            return _traced(came_from, start, end)
        for after in routing.following_ids(current):
            to_end = length + length_m(lanelets[after].left_map)
            heapq.heappush(ahead, (to_end, after, current))
    return ()


def _traced(came_from: dict[int, int], start: int, end: int) -> tuple[int, ...]:
    path = [end]
    while path[-1] != start:
        path.append(came_from[path[-1]])
    return tuple(reversed(path))


@dataclass(frozen=True, slots=True)
class Track:
    """The borders along some lanelets, each as one line."""

    left: LineString
    right: LineString

    @classmethod
    def along(cls, checked: CheckedMap, path: Sequence[int]) -> Track:
        """Return the track of lanelets that follow each other."""
        lanelets = [checked.hd_map.lanelets[i] for i in path]
        return cls(
            LineString(np.concatenate([lanelet.left_map[:, :2] for lanelet in lanelets])),
            LineString(np.concatenate([lanelet.right_map[:, :2] for lanelet in lanelets])),
        )

    def place(self, line: LineString) -> _F64:
        """Return how far along the left and the right border (2,) the ends of a line lie, metres.

        Each end is measured on the border that it is nearer to than the other end is, so that it
        does not matter which way the line is drawn.
        """
        ends = [Point(line.coords[0]), Point(line.coords[-1])]
        left, right = sorted(ends, key=lambda p: p.distance(self.left) - p.distance(self.right))
        return np.array([self.left.project(left), self.right.project(right)])
