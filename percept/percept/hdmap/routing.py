"""How lanelets hang together: which follow, and which lie beside each other.

As Lanelet2's routing graph: one lanelet follows another where both of its borders begin at the
points at which the other's end; two lie beside each other where they share a border; the type of
that border, or its tags `lane_change`, says whether one may change over.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from percept.hdmap.elements import Lanelet
from percept.hdmap.osm import OsmWay
from percept.hdmap.participants import may_pass, may_pass_in_reverse, truth

__all__ = ["Neighbour", "Passage", "RoutingGraph", "make_routing"]

_LANE_LINES = ("line_thin", "line_thick")
_LEFT_AND_RIGHT: Mapping[str, tuple[bool, bool]] = {
    "dashed": (True, True),
    "dashed_solid": (False, True),
    "solid_dashed": (True, False),
}


class Passage(NamedTuple):
    """A lanelet as one drives through it.

    Attributes:
        lanelet_id: The lanelet.
        reverse: Against the direction of its borders, as two-way lanelets allow.
    """

    lanelet_id: int
    reverse: bool = False


class Neighbour(NamedTuple):
    """A lanelet beside another.

    Attributes:
        lanelet_id: The lanelet.
        opposite: It runs the other way.
        lane_change: One may change over to it.
        border_id: The line string between the two.
    """

    lanelet_id: int
    opposite: bool
    lane_change: bool
    border_id: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoutingGraph:
    """Where a participant can drive on from lanelets.

    Attributes:
        participant: Who drives; None for a graph of all lanelets, whoever they admit.
        following: What follows on each way through a lanelet, ids rising.
        previous: What leads to each way through a lanelet, ids rising.
        left: What lies left of each lanelet in its own direction, ids rising.
        right: What lies right of it.
    """

    participant: str | None
    following: Mapping[Passage, tuple[Passage, ...]]
    previous: Mapping[Passage, tuple[Passage, ...]]
    left: Mapping[int, tuple[Neighbour, ...]]
    right: Mapping[int, tuple[Neighbour, ...]]

    def following_ids(self, lanelet_id: int) -> tuple[int, ...]:
        """Return lanelets that follow one in its own direction, driven in theirs."""
        return _forward(self.following.get(Passage(lanelet_id), ()))

    def previous_ids(self, lanelet_id: int) -> tuple[int, ...]:
        """Return lanelets that lead to one in its own direction, driven in theirs."""
        return _forward(self.previous.get(Passage(lanelet_id), ()))


def _forward(passages: Sequence[Passage]) -> tuple[int, ...]:
    return tuple(passage.lanelet_id for passage in passages if not passage.reverse)


def make_routing(
    lanelets: Mapping[int, Lanelet],
    ways: Mapping[int, OsmWay],
    participant: str | None = "vehicle",
) -> RoutingGraph:
    """Return the graph of the lanelets that a participant may use.

    Args:
        lanelets: Lanelets by id.
        ways: The line strings that bound them, by id.
        participant: Who drives, such as `vehicle`, `vehicle:bus` or `pedestrian`; None takes all
            lanelets, in the direction of their borders.
    """
    passages = sorted(_passages(lanelets, participant))
    begins = defaultdict(list)
    for passage in passages:
        begins[_ends(lanelets[passage.lanelet_id], reverse=passage.reverse)[0]].append(passage)
    following, previous = {}, defaultdict(list)
    for passage in passages:
        end = _ends(lanelets[passage.lanelet_id], reverse=passage.reverse)[1]
        # A lanelet is not followed by itself driven back.
        after = [p for p in begins.get(end, ()) if p.lanelet_id != passage.lanelet_id]
        following[passage] = tuple(after)
        for other in after:
            previous[other].append(passage)
    left, right = _neighbours(lanelets, ways, set(passages), participant)
    return RoutingGraph(
        participant=participant,
        following=following,
        previous={passage: tuple(previous[passage]) for passage in passages},
        left=left,
        right=right,
    )


def _passages(lanelets: Mapping[int, Lanelet], participant: str | None) -> Iterator[Passage]:
    for identity, lanelet in lanelets.items():
        if participant is None or may_pass(lanelet.tags, participant):
            yield Passage(identity)
            if participant is not None and may_pass_in_reverse(lanelet.tags, participant):
                yield Passage(identity, reverse=True)


def _ends(lanelet: Lanelet, *, reverse: bool) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the points (left, right) at which a lanelet begins and those at which it ends."""
    left, right = lanelet.left_nodes, lanelet.right_nodes
    if reverse:
        left, right = right[::-1], left[::-1]
    return (left[0], right[0]), (left[-1], right[-1])


class _Side(NamedTuple):
    """One line string of a border: along tells whether the lanelet runs with its points."""

    lanelet_id: int
    is_left: bool
    along: bool


def _neighbours(
    lanelets: Mapping[int, Lanelet],
    ways: Mapping[int, OsmWay],
    passages: set[Passage],
    participant: str | None,
) -> tuple[dict[int, tuple[Neighbour, ...]], dict[int, tuple[Neighbour, ...]]]:
    found: tuple[dict[int, set[Neighbour]], ...] = (
        {p.lanelet_id: set() for p in passages},
        {p.lanelet_id: set() for p in passages},
    )
    for border_id, sides in _sides(lanelets, ways, found[0]).items():
        for one in sides:
            for other in sides:
                opposite = one.along != other.along
                # Beside each other: on different hands of the line, whichever way they run.
                if one.lanelet_id == other.lanelet_id or (one.is_left == other.is_left) != opposite:
                    continue
                change = Passage(other.lanelet_id, opposite) in passages and _may_change(
                    ways[border_id].tags, one, participant or "vehicle"
                )
                beside = Neighbour(other.lanelet_id, opposite, change, border_id)
                found[0 if one.is_left else 1][one.lanelet_id].add(beside)
    left, right = ({i: tuple(sorted(there)) for i, there in side.items()} for side in found)
    return left, right


def _sides(
    lanelets: Mapping[int, Lanelet], ways: Mapping[int, OsmWay], used: Mapping[int, object]
) -> dict[int, list[_Side]]:
    """Return by line string the lanelets that it bounds."""
    sides = defaultdict(list)
    for identity in used:
        lanelet = lanelets[identity]
        borders = ((lanelet.left_ids, lanelet.left_nodes), (lanelet.right_ids, lanelet.right_nodes))
        for is_left, (ids, nodes) in zip((True, False), borders, strict=True):
            steps = set(pairwise(nodes))
            for border_id in ids:
                first_step = ways[border_id].nodes[:2]
                sides[border_id].append(_Side(identity, is_left, first_step in steps))
    return sides


def _may_change(tags: Mapping[str, str], side: _Side, participant: str) -> bool:
    """Return whether a line may be crossed by a lanelet that it bounds on one side."""
    to_left, to_right = _crossings(tags, participant)
    # The lanelet crosses to the line's left if the line is its left border and runs along.
    return to_left if side.is_left == side.along else to_right


def _crossings(tags: Mapping[str, str], participant: str) -> tuple[bool, bool]:
    """Return whether a line may be crossed to its left, and to its right."""
    if "lane_change" in tags:
        both = truth(tags["lane_change"]) is True
        return both, both
    sided = [tags.get(f"lane_change:{side}") for side in ("left", "right")]
    if any(word is not None for word in sided):
        return truth(sided[0]) is True, truth(sided[1]) is True
    kind, subtype = tags.get("type", ""), tags.get("subtype", "")
    may_drive = participant.startswith("vehicle") or participant == "bicycle"
    if may_drive and kind in _LANE_LINES and subtype in _LEFT_AND_RIGHT:
        return _LEFT_AND_RIGHT[subtype]
    low = participant in ("pedestrian", "bicycle") and (kind, subtype) == ("curbstone", "low")
    return low, low
