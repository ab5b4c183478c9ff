"""Changes planted between made roads and their maps, and how findings are scored by them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from made_paint import Road, Way, World, distances, moved_aside
from numpy.typing import NDArray

from percept.core.lane_markings import PaintObservation
from percept.core.map_findings import Decision, Discrepancy, Kind
from percept.core.trajectory import Trajectory
from percept.hdmap.validate import Validation, ValidationConfig, validate_lanes

_F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Change:
    """A planted difference between road and map."""

    kind: Kind
    element_id: int
    middle: _F64
    size_m: float = 0.0
    length_m: float = 0.0


_REPAINTED = {
    "solid": ("dashed", "solid_solid"),
    "dashed": ("solid",),
    "solid_solid": ("solid", "solid_dashed", "dashed_solid", "dashed"),
}
LINE_KINDS = (Kind.MOVED, Kind.MISSING_ON_ROAD, Kind.MISSING_IN_MAP, Kind.TYPE, Kind.COLOUR)
LEAST_SEEN_M = {True: 1.0, False: 40.0}
STOP_KINDS = (Kind.STOP_LINE_MISSING, Kind.STOP_LINE_MOVED, Kind.STOP_LINE_MISSING_IN_MAP)


def changed(world: World, seed: int, count: int) -> tuple[World, list[Change]]:
    """Plant changes, one a way or stop line, of all kinds in turn; some in a part of a way."""
    rng = np.random.default_rng(seed)
    ways, stops = dict(world.road.ways), dict(world.road.stops)
    gone_from_map: set[int] = set()
    idents, bars = list(rng.permutation(list(ways))), list(rng.permutation(list(stops)))
    kinds = [*LINE_KINDS, *LINE_KINDS, *STOP_KINDS]
    changes: list[Change] = []
    for kind in (kinds * count)[:count]:
        if not (bars if kind in STOP_KINDS else idents):
            continue
        if kind in STOP_KINDS:
            changes.append(_stop_change(rng, kind, int(bars.pop()), stops, gone_from_map))
        else:
            # The outermost line is seen from afar only: what type it has cannot be told there.
            far = kind in (Kind.MISSING_IN_MAP, Kind.TYPE)
            good = [k for k in idents if not far or k % 10 < 4]
            idents.remove(good[-1])
            changes.append(_line_change(rng, kind, int(good[-1]), ways, gone_from_map))
    road = Road(ways, stops, world.road.stop_ahead)
    markings = tuple(m for m in world.markings if m.element_id not in gone_from_map)
    return replace(world, road=road, markings=markings), changes


def _line_change(
    rng: np.random.Generator, kind: Kind, ident: int, ways: dict[int, Way], lost: set[int]
) -> Change:
    way = ways[ident]
    count = len(way.points)
    first, last = 0, count
    if kind is not Kind.MISSING_IN_MAP and count > 120 and rng.random() < 0.4:
        first = int(rng.integers(10, count // 3))
        last = int(rng.integers(2 * count // 3, count - 10))
    part = replace(way, points=way.points[first:last])
    size = 0.0
    if kind is Kind.MISSING_IN_MAP:
        lost.add(ident)
    elif kind is Kind.MOVED:
        size = float(rng.uniform(0.42, 0.8) * rng.choice([-1, 1]))
        part = replace(part, points=moved_aside(part.points, size))
    elif kind is Kind.TYPE:
        part = replace(part, type=str(rng.choice(_REPAINTED[way.type])))
    elif kind is Kind.COLOUR:
        part = replace(part, colour="white" if way.colour == "yellow" else "yellow")
    pieces = [replace(way, points=way.points[: first + 1]), part,
              replace(way, points=way.points[last - 1 :])]  # fmt: skip
    if kind is Kind.MISSING_ON_ROAD:
        pieces.pop(1)
    del ways[ident]
    for number, piece in enumerate(pieces):
        if len(piece.points) > 2:
            ways[ident + 100_000 * number] = piece
    length = float(distances(way.points[first:last])[-1])
    return Change(kind, ident, way.points[(first + last) // 2, :2], size, length)


def _stop_change(
    rng: np.random.Generator, kind: Kind, ident: int, stops: dict[int, _F64], lost: set[int]
) -> Change:
    points, size = stops[ident], 0.0
    if kind is Kind.STOP_LINE_MISSING:
        del stops[ident]
    elif kind is Kind.STOP_LINE_MISSING_IN_MAP:
        lost.add(ident)
    else:
        size = float(rng.uniform(0.9, 2.5) * rng.choice([-1, 1]))
        # From the left to the right end: the left of that is ahead.
        stops[ident] = moved_aside(points, size)
    return Change(kind, ident, points[:, :2].mean(axis=0), size)


def turned_ways(world: World) -> World:
    """Return the world with every second line of the map drawn the other way."""
    mirrored = {"solid_dashed": "dashed_solid", "dashed_solid": "solid_dashed"}
    markings = tuple(
        replace(m, points_map=m.points_map[::-1], type=mirrored.get(m.type, m.type))
        if m.element_id % 2
        else m
        for m in world.markings
    )
    return replace(world, markings=markings)


def rigidly(world: World, poses: Trajectory, T_new_map: _F64) -> tuple[World, Trajectory]:
    """Return map and poses in another frame; what the camera sees stays as it is."""

    def moved(points: _F64) -> _F64:
        return points @ T_new_map[:3, :3].T + T_new_map[:3, 3]

    markings = tuple(replace(m, points_map=moved(m.points_map)) for m in world.markings)
    lanelets = {
        ident: replace(one, left_map=moved(one.left_map), right_map=moved(one.right_map))
        for ident, one in world.lanelets.items()
    }
    matrices = T_new_map @ poses.matrices
    return (
        replace(world, markings=markings, lanelets=lanelets),
        replace(poses, matrices=matrices),
    )


@dataclass
class Score:
    """Planted changes of one kind that were found, and findings that were none."""

    found: int = 0
    lost: int = 0
    false: int = 0

    def add(self, other: Score) -> None:
        self.found += other.found
        self.lost += other.lost
        self.false += other.false

    @property
    def f1(self) -> float:
        return 2 * self.found / max(2 * self.found + self.lost + self.false, 1)


def score(changes: list[Change], result: Validation) -> dict[Kind, Score]:
    """Match findings with changes by kind and element, or place where the map has none.

    What was not observed is no change that could be found.
    """
    scores = {kind: Score() for kind in Kind}
    seen = {row.map_element_id: 0.0 for row in result.coverage}
    for row in result.coverage:
        seen[row.map_element_id] += row.length_m * row.observed_share
    open_changes = list(changes)
    for finding in result.discrepancies:
        match = next((c for c in open_changes if is_about(c, finding)), None)
        if match is None:
            scores[finding.kind].false += 1
        else:
            # Two ways of one line that the map lacks, one after the other, are one finding.
            whole = finding.kind is Kind.MISSING_IN_MAP
            matched = [c for c in open_changes if is_about(c, finding)] if whole else [match]
            scores[finding.kind].found += len(matched)
            open_changes = [c for c in open_changes if c not in matched]
    for change in open_changes:
        in_map = change.kind not in (Kind.MISSING_IN_MAP, Kind.STOP_LINE_MISSING_IN_MAP)
        if in_map and seen.get(change.element_id, 0.0) < LEAST_SEEN_M[change.kind in STOP_KINDS]:
            continue
        scores[change.kind].lost += 1
    return scores


def is_about(change: Change, finding: Discrepancy) -> bool:
    if change.kind is not finding.kind:
        return False
    if finding.map_element_id:
        return change.element_id == finding.map_element_id
    points = finding.points_map[:, :2]
    shares = np.linspace(0, 1, 21)[:, None] if len(points) > 2 else np.full((1, 1), 0.5)
    between = np.concatenate([a + shares * (b - a) for a, b in pairwise(points)])
    return bool(np.linalg.norm(between - change.middle, axis=1).min() < 2.0)


def validated(
    world: World,
    *drives: tuple[Trajectory, Iterator[PaintObservation]],
    decisions: tuple[Decision, ...] = (),
) -> Validation:
    """Return what drives say of the map of a world."""
    named = [(f"drive {k}", poses, looks) for k, (poses, looks) in enumerate(drives)]
    return validate_lanes(world, named, ValidationConfig(), decisions)


def kinds(result: Validation) -> list[tuple[Kind, int]]:
    return sorted((finding.kind, finding.map_element_id) for finding in result.discrepancies)


def with_ways(world: World, ways: dict[int, Way]) -> World:
    """Return the world with other ways of paint on its road; the map stays."""
    return replace(world, road=replace(world.road, ways=ways))


def without(world: World, *idents: int) -> World:
    """Return the world with ways of paint gone from its road; the map stays."""
    return with_ways(world, {k: way for k, way in world.road.ways.items() if k not in idents})
