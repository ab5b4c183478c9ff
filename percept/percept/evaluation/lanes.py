"""Lines and stop lines that were seen on a road, in metres, against where they are.

Each point of a line that was seen is held against the nearest line of the road, in the frame of
the vehicle at that moment; each stop line against the nearest one along the lane.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from percept.core.trajectory import Trajectory
from percept.evaluation.lane_scores import RoadLaneScores
from percept.evaluation.road_truth import RoadMarking

__all__ = ["SeenFrame", "SeenLine", "score_road_lanes"]

_F64 = NDArray[np.float64]

_LINE_GATE_M, _STOP_LINE_GATE_M = 1.0, 3.0
_NEARBY_M = 60.0
_SIDES_AT_M = 6.0
_UNKNOWN = "unknown"
_METRES = ("length_m", "right_type_m", "right_colour_m", "unknown_type_m", "unknown_colour_m")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SeenLine:
    """A line as it was seen.

    Attributes:
        side: `left`, `right` or `other`.
        points_m: (K, 2) float64 x forward, y left in the vehicle's frame.
        type: Its type in the words of Lanelet2.
        colour: Its colour.
    """

    side: str
    points_m: _F64
    type: str
    colour: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SeenFrame:
    """What was seen at a moment.

    Attributes:
        stamp_ns: Time of the image.
        lines: Lines.
        stop_lines_m: Distances of stop lines from the vehicle's origin along the lane.
    """

    stamp_ns: int
    lines: tuple[SeenLine, ...]
    stop_lines_m: tuple[float, ...] = ()


def score_road_lanes(
    frames: Sequence[SeenFrame], markings: Sequence[RoadMarking], poses: Trajectory
) -> RoadLaneScores:
    """Hold what was seen against the road.

    What hides a line or stop line is not considered: a share of what was found counts also what
    could not be seen.

    Args:
        frames: What was seen, image by image.
        markings: Lines and stop lines of the road in the map frame.
        poses: True poses T_map_base.
    """
    tally = _Tally()
    for frame in frames:
        T_map_base = poses.at(frame.stamp_ns)
        if T_map_base is None:
            tally.dropped["images at times without a true pose"] += 1
            continue
        T_base_map = T_map_base.inverse()
        placed = [(one, T_base_map.apply(one.points_map)) for one in markings]
        near = [(one, points) for one, points in placed if _is_near(points)]
        tally.frames += 1
        _score_lines(tally, frame, [pair for pair in near if pair[0].kind == "line"])
        _score_stops(tally, frame, [p for one, p in near if one.kind == "stop_line"])
    return tally.scores()


@dataclass(slots=True)
class _Tally:
    """Figures while they are gathered."""

    frames: int = 0
    both_sides: int = 0
    stray_points: int = 0
    false_stops: int = 0
    lateral: list[_F64] = field(default_factory=list)
    metres: dict[str, float] = field(default_factory=lambda: dict.fromkeys(_METRES, 0.0))
    stops: list[tuple[float, float]] = field(default_factory=list)
    ahead: list[tuple[float, bool]] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)

    def scores(self) -> RoadLaneScores:
        """Return what was gathered."""
        ahead = np.array(self.ahead, dtype=np.float64).reshape(-1, 2)
        return RoadLaneScores(
            frames=self.frames,
            both_sides=self.both_sides,
            lateral=np.concatenate([np.zeros((0, 2)), *self.lateral]),
            stray_points=self.stray_points,
            **self.metres,
            stops=np.array(self.stops, dtype=np.float64).reshape(-1, 2),
            stops_ahead=ahead[:, 0],
            stops_found=ahead[:, 1] > 0,
            false_stops=self.false_stops,
            dropped=self.dropped,
        )


def _score_lines(
    tally: _Tally, frame: SeenFrame, lines: Sequence[tuple[RoadMarking, _F64]]
) -> None:
    offsets: dict[str, list[float]] = {"left": [], "right": []}
    for line in frame.lines:
        errors, owners = _nearest(line.points_m, [points for _, points in lines])
        on_line = np.abs(errors) <= _LINE_GATE_M
        tally.stray_points += int((~on_line).sum())
        ranges = np.linalg.norm(line.points_m, axis=1)
        tally.lateral.append(np.column_stack([ranges, errors])[on_line])
        _add_lengths(tally.metres, line, on_line, [lines[k][0] for k in owners])
        if line.side in offsets and on_line.any():
            offsets[line.side].append(_offset_at(line.points_m[on_line]))
    tally.both_sides += _are_sides(offsets, [points for _, points in lines])


def _add_lengths(
    metres: dict[str, float],
    line: SeenLine,
    on_line: NDArray[np.bool_],
    owners: Sequence[RoadMarking],
) -> None:
    """Add half of the steps to both neighbours for each point that lies on a line."""
    steps = np.linalg.norm(np.diff(line.points_m, axis=0), axis=1)
    lengths = (np.append(0.0, steps) + np.append(steps, 0.0)) / 2
    for length, owner in zip(lengths[on_line].tolist(), _kept(owners, on_line), strict=True):
        metres["length_m"] += length
        metres["right_type_m"] += length * (line.type == owner.type)
        metres["right_colour_m"] += length * (line.colour == owner.colour)
        metres["unknown_type_m"] += length * (line.type == _UNKNOWN)
        metres["unknown_colour_m"] += length * (line.colour == _UNKNOWN)


def _kept(owners: Sequence[RoadMarking], kept: NDArray[np.bool_]) -> list[RoadMarking]:
    return [owner for owner, keep in zip(owners, kept, strict=True) if keep]


def _are_sides(offsets: Mapping[str, Sequence[float]], lines: Sequence[_F64]) -> bool:
    """Return whether the lines that bound the lane were seen, and are the nearest ones."""
    truth = [y for points in lines if (y := _crossing(points)) is not None]
    left = min((y for y in truth if y > 0), default=math.inf)
    right = max((y for y in truth if y <= 0), default=-math.inf)
    return all(
        any(abs(offset - real) <= _LINE_GATE_M for offset in offsets[side])
        for side, real in (("left", left), ("right", right))
    )


def _crossing(points: _F64) -> float | None:
    """Return y of a line of the road a little before the vehicle; None where it does not reach."""
    order = np.argsort(points[:, 0])
    x, y = points[order, 0], points[order, 1]
    return float(np.interp(_SIDES_AT_M, x, y)) if x[0] <= _SIDES_AT_M <= x[-1] else None


def _offset_at(points_m: _F64) -> float:
    """Return y of a line that was seen a little before the vehicle, as its nearest points say."""
    order = np.argsort(points_m[:, 0])
    return float(np.interp(_SIDES_AT_M, points_m[order, 0], points_m[order, 1]))


def _nearest(points_m: _F64, lines: Sequence[_F64]) -> tuple[_F64, NDArray[np.intp]]:
    """Return the signed distance (K,) of points to the nearest line, left +, and which it is."""
    best, owner = np.full(len(points_m), np.inf), np.zeros(len(points_m), dtype=np.intp)
    for number, line in enumerate(lines):
        for start, end in pairwise(line[:, :2]):
            way = (end - start) * (1.0 if end[0] >= start[0] else -1.0)
            first = start if end[0] >= start[0] else end
            length = max(float(np.linalg.norm(way)), 1e-9)
            apart = points_m - first
            along = apart @ way / length
            across = (way[0] * apart[:, 1] - way[1] * apart[:, 0]) / length
            beside = (along >= -0.5) & (along <= length + 0.5)
            closer = beside & (np.abs(across) < np.abs(best))
            best[closer], owner[closer] = across[closer], number
    return best, owner


def _score_stops(tally: _Tally, frame: SeenFrame, stops: Sequence[_F64]) -> None:
    real = [x for points in stops if (x := _distance_along(points)) is not None and x > 0]
    left = list(frame.stop_lines_m)
    for distance in sorted(real):
        seen = min(left, key=lambda one: abs(one - distance), default=math.inf)
        hit = abs(seen - distance) <= _STOP_LINE_GATE_M
        tally.ahead.append((distance, hit))
        if hit:
            left.remove(seen)
            tally.stops.append((distance, seen - distance))
    tally.false_stops += len(left)


def _distance_along(points: _F64) -> float | None:
    """Return where a stop line crosses the vehicle's x axis; None where it does not."""
    (x0, y0), (x1, y1) = points[0, :2].tolist(), points[-1, :2].tolist()
    if y0 * y1 > 0 or y0 == y1:
        return None
    return float(x0 + (x1 - x0) * y0 / (y0 - y1))


def _is_near(points: _F64) -> bool:
    return bool(np.abs(points[:, 0]).min() <= _NEARBY_M)
