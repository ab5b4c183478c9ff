"""Where changes can be planted into the map of a drive, so that a camera driving by can tell.

A change is planted only where the front camera sees its place well, and never so near to
another one that a finding could mean either.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Kind
from percept.datasets.synthetic.lanelet_map import BORDERS, Piece, street_pieces
from percept.datasets.synthetic.layout import BLOCK_M, Placed, block_at
from percept.datasets.synthetic.map_sight import DriveSight
from percept.datasets.synthetic.terrain import LANE_WIDTH_M
from percept.datasets.synthetic.world import World

__all__ = [
    "BAR_Y_M",
    "HeadSite",
    "LineSite",
    "Site",
    "StopLineSite",
    "choose_sites",
    "sites_of_drive",
]

BAR_Y_M = (-6.9, -0.25)
"""From the right to the left end of a stop line for traffic along +x, as layout has them."""

_F64 = NDArray[np.float64]
_SHORTEST_PIECE_M = 25.0
_LINE_RANGE_M, _BAR_RANGE_M, _HEAD_RANGE_M = (4.0, 15.0), (4.0, 12.0), (15.0, 45.0)
_LINE_LOOKS, _BAR_LOOKS, _HEAD_LOOKS = 3, 2, 10
_SHARE_SEEN = 0.85
_TRACKS_APART, _TRACKS_APART_ALONG, _NEXT_M = 3, 2, 5.0
_ADDED_BARS_M = (20.0, 45.0, 70.0)
_ADDED_HEAD_Y_M = 0.45
_ADDED_HEAD_IDS = -(10**9)

_ON_LINES = (Kind.MOVED, Kind.TYPE, Kind.COLOUR, Kind.MISSING_IN_MAP)


class Site(Protocol):
    """A place at which one kind of change can be made."""

    @property
    def kind(self) -> Kind:
        """The kind of finding that it is to give."""

    @property
    def x_m(self) -> float:
        """Where it begins along the street."""

    def clashes(self, other: Site) -> bool:
        """Return whether the two changes could be taken for one another."""

    def seen(self, sight: DriveSight) -> bool:
        """Return whether the camera of a drive sees the place well."""


@dataclass(frozen=True, slots=True)
class LineSite:
    """A line along a piece of the street.

    Attributes:
        kind: The kind of finding.
        piece: The piece.
        track: Its place across the street, in half lanes from the right: even ones are borders
            of lanes (`BORDERS[track // 2]`), odd ones the middles of lanes, where no line is.
    """

    kind: Kind
    piece: Piece
    track: int

    @property
    def x_m(self) -> float:
        """Where the piece begins."""
        return self.piece.start_m

    @property
    def y_m(self) -> float:
        """Where the track lies across the street."""
        return BORDERS[0].y_m + self.track * LANE_WIDTH_M / 2

    def clashes(self, other: Site) -> bool:
        """Return whether the two lie beside or behind one another, or one moves beside."""
        if not isinstance(other, LineSite):
            return False
        apart = abs(self.track - other.track)
        if self.piece == other.piece:
            return apart < _TRACKS_APART or Kind.MOVED in (self.kind, other.kind)
        first, second = sorted((self.piece, other.piece), key=lambda piece: piece.start_m)
        return second.start_m - first.end_m < _NEXT_M and apart < _TRACKS_APART_ALONG

    def seen(self, sight: DriveSight) -> bool:
        """Return whether nearly all of it lies on the way and is looked at from near."""
        start, end = self.piece.start_m, self.piece.end_m
        if start < sight.span_m[0] or end > sight.span_m[1]:
            return False
        x = np.arange(start + 1.0, end, 2.0)
        points = _on_road(sight.world, x, np.full(len(x), self.y_m))
        looks = sight.looks(points, *_LINE_RANGE_M)
        return float((looks >= _LINE_LOOKS).mean()) >= _SHARE_SEEN


@dataclass(frozen=True, slots=True)
class StopLineSite:
    """A stop line across the lanes that the vehicle drives along.

    Attributes:
        kind: The kind of finding.
        block: Number of the block of the street in the map, from 0.
        x_m: The edge that drivers reach first.
    """

    kind: Kind
    block: int
    x_m: float

    def clashes(self, other: Site) -> bool:
        """Return whether both are of one bar, or both are added to one block."""
        return (
            isinstance(other, StopLineSite)
            and self.block == other.block
            and (self.kind is Kind.STOP_LINE_MISSING) == (other.kind is Kind.STOP_LINE_MISSING)
        )

    def seen(self, sight: DriveSight) -> bool:
        """Return whether nearly all of it before the vehicle is looked at from near."""
        if not sight.span_m[0] <= self.x_m <= sight.span_m[1]:
            return False
        y = np.arange(BAR_Y_M[0], -LANE_WIDTH_M / 2, 0.5)
        points = _on_road(sight.world, np.full(len(y), self.x_m), y)
        looks = sight.looks(points, *_BAR_RANGE_M)
        return float((looks >= _BAR_LOOKS).mean()) >= _SHARE_SEEN


@dataclass(frozen=True, slots=True, eq=False)
class HeadSite:
    """A signal head for the traffic along the vehicle's way.

    Attributes:
        kind: The kind of finding.
        block: Number of the block of the street in the map, from 0.
        head: The head; one that is added stands on no street.
    """

    kind: Kind
    block: int
    head: Placed

    @property
    def x_m(self) -> float:
        """Where the head hangs."""
        return self.head.x_m

    def clashes(self, other: Site) -> bool:
        """Return whether both are of one signal."""
        return isinstance(other, HeadSite) and self.block == other.block

    def seen(self, sight: DriveSight) -> bool:
        """Return whether the vehicle drives up to it and sees it for seconds."""
        if self.head.x_m > sight.span_m[1]:
            return False
        middle = sight.world.place(self.head, 0.0) @ np.append(self.head.shape.middle, 1.0)
        return int(sight.looks(middle[None, :3], *_HEAD_RANGE_M)[0]) >= _HEAD_LOOKS


def sites_of_drive(world: World, blocks: range, span_m: tuple[float, float]) -> list[Site]:
    """Return all places of a stretch of the street at which a change can be made.

    Args:
        world: The street.
        blocks: Numbers of the blocks that the map holds.
        span_m: From where to where along the street.
    """
    found = [*_line_sites(world, blocks), *_block_sites(world, blocks)]
    return [site for site in found if span_m[0] <= site.x_m <= span_m[1]]


def choose_sites(
    sites: Sequence[Site],
    count: int,
    is_seen: Callable[[Site], bool],
    rng: np.random.Generator,
    tries: int,
) -> list[Site]:
    """Choose sites, spread over kinds as evenly as they allow, none beside another.

    Args:
        sites: All that there are.
        count: How many are wanted.
        is_seen: Whether a site is seen well; asked of a site only when it is drawn.
        rng: Source of the choice.
        tries: How often to draw at most, until all fit and kinds are even.

    Returns:
        As many as fit, at most `count`, in the order of the street.
    """
    kinds = {site.kind for site in sites}
    best: list[Site] = []
    for _ in range(tries):
        best = max(best, _draw(sites, count, is_seen, rng), key=_merit)
        counts = [sum(site.kind is kind for site in best) for kind in kinds]
        if len(best) == count and max(counts) - min(counts) <= 1:
            break
    return sorted(best, key=lambda site: (site.x_m, site.kind))


def _merit(chosen: Sequence[Site]) -> tuple[int, int]:
    """Return how many were chosen, and less the more of them are of one kind."""
    counts = Counter(site.kind for site in chosen)
    return len(chosen), -sum(count**2 for count in counts.values())


def _draw(
    sites: Sequence[Site], count: int, is_seen: Callable[[Site], bool], rng: np.random.Generator
) -> list[Site]:
    """Take one site of each kind in turn until there are enough, or none is left that fits."""
    kinds = sorted({site.kind for site in sites})
    order = [sites[k] for k in rng.permutation(len(sites))]
    left = {
        kinds[k]: [site for site in order if site.kind is kinds[k]]
        for k in rng.permutation(len(kinds))
    }
    chosen: list[Site] = []
    while len(chosen) < count and any(left.values()):
        for waiting in left.values():
            while waiting and len(chosen) < count:
                site = waiting.pop()
                if not any(site.clashes(other) for other in chosen) and is_seen(site):
                    chosen.append(site)
                    break
    return chosen


def _line_sites(world: World, blocks: range) -> Iterator[Site]:
    for piece in street_pieces(world, blocks):
        if piece.end_m - piece.start_m < _SHORTEST_PIECE_M:
            continue
        for track in (0, 2, 4):
            yield from (LineSite(kind, piece, track) for kind in _ON_LINES)
        for track in (1, 3):
            yield LineSite(Kind.MISSING_ON_ROAD, piece, track)


def _block_sites(world: World, blocks: range) -> Iterator[Site]:
    for number, block in enumerate(blocks):
        content = block_at(world.seed, block)
        stop_m = content.stop_lines[0].near_x_m
        yield StopLineSite(Kind.STOP_LINE_MOVED, number, stop_m)
        yield StopLineSite(Kind.STOP_LINE_MISSING_IN_MAP, number, stop_m)
        for x in _ADDED_BARS_M:
            yield StopLineSite(Kind.STOP_LINE_MISSING, number, block * BLOCK_M + x)
        heads = [signal.head for signal in content.signals if signal.head.yaw_rad > 0]
        for head in heads:
            yield HeadSite(Kind.TRAFFIC_LIGHT_MISSING_IN_MAP, number, head)
        beside = heads[0]
        identity = beside.object_id + _ADDED_HEAD_IDS
        added = Placed(
            identity, beside.shape, beside.x_m, _ADDED_HEAD_Y_M, beside.z_m, beside.yaw_rad
        )
        yield HeadSite(Kind.TRAFFIC_LIGHT_MISSING, number, added)


def _on_road(world: World, x_m: _F64, y_m: _F64) -> _F64:
    return np.column_stack([x_m, y_m, world.profile.height(x_m)])
