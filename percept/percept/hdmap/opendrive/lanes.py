"""Borders of lanes of a road and the marks on them, as lines in space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from percept.hdmap.opendrive.document import Numbers
from percept.hdmap.opendrive.marks import Mark, read_mark
from percept.hdmap.opendrive.road_line import PiecewiseCubic, RoadLine

__all__ = ["MarkedLine", "marked_lines"]

_F64 = NDArray[np.float64]
_STEP_M = 1.0
_SHORTEST_M = 1e-3
_LONGEST_M = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class MarkedLine:
    """One mark along one border.

    Attributes:
        lane_id: The lane whose outer border it is on; 0 is the middle of the road.
        mark: What is painted.
        points_map: (K, 3) float64 in the frame of the file, along the reference line.
    """

    lane_id: int
    mark: Mark
    points_map: _F64


@dataclass(frozen=True, slots=True, eq=False)
class _Lane:
    """A lane of a section: its marks, and the width, or place, of its outer border."""

    lane_id: int
    marks: tuple[Mark, ...]
    width: PiecewiseCubic
    border: PiecewiseCubic | None


def marked_lines(road: etree._Element, line: RoadLine, numbers: Numbers) -> Iterator[MarkedLine]:
    """Yield the marks of a road's lanes, section by section.

    Raises:
        InputError: If a number is none, or the road is too long to be one.
    """
    sections = road.findall("lanes/laneSection")
    if not 0 <= line.length <= _LONGEST_M:
        raise numbers.error(f"length {line.length:g} m is no length of a road")
    starts = [numbers.number(section, "s") for section in sections]
    order = np.argsort(starts, kind="stable").tolist()
    ends = [*(starts[k] for k in order[1:]), line.length]
    for k, end in zip(order, ends, strict=True):
        yield from _of_section(sections[k], (starts[k], min(end, line.length)), line, numbers)


def _of_section(
    section: etree._Element, span: tuple[float, float], line: RoadLine, numbers: Numbers
) -> Iterator[MarkedLine]:
    for side, sign in (("center", 0), ("left", 1), ("right", -1)):
        lanes = [_read_lane(lane, numbers) for lane in section.iterfind(f"{side}/lane")]
        lanes.sort(key=lambda lane: abs(lane.lane_id))
        for k, lane in enumerate(lanes):
            for mark, start, end in _spans(lane.marks, span):
                lengths = _lengths(start, end, span[0], line, lanes[: k + 1])
                offsets = sign * _outer_border(lanes[: k + 1], lengths - span[0])
                yield MarkedLine(lane.lane_id, mark, line.points(lengths, offsets))


def _read_lane(element: etree._Element, numbers: Numbers) -> _Lane:
    identity = round(numbers.number(element, "id"))
    marks = [read_mark(mark, identity, numbers) for mark in element.iterfind("roadMark")]
    widths, borders = element.findall("width"), element.findall("border")
    return _Lane(
        lane_id=identity,
        marks=tuple(sorted(marks, key=lambda mark: mark.start)),
        width=PiecewiseCubic.of(widths, numbers, "sOffset"),
        border=PiecewiseCubic.of(borders, numbers, "sOffset") if borders and not widths else None,
    )


def _outer_border(lanes: Sequence[_Lane], along: _F64) -> _F64:
    """Return how far (N,) the outer border of the last lane lies from lane 0, to either side."""
    away = np.zeros_like(along)
    for lane in lanes:
        away = np.abs(lane.border(along)) if lane.border else away + lane.width(along)
    return away


def _spans(marks: Sequence[Mark], span: tuple[float, float]) -> Iterator[tuple[Mark, float, float]]:
    """Yield the marks with where they start and end on the road, each up to the next one."""
    start, end = span
    ends = [*(start + mark.start for mark in marks[1:]), end]
    for mark, stop in zip(marks, ends, strict=True):
        first, last = max(start + mark.start, start), min(stop, end)
        if mark.type and last - first > _SHORTEST_M:
            yield replace(mark, start=first - start), first, last


def _lengths(
    start: float, end: float, section_m: float, line: RoadLine, lanes: Sequence[_Lane]
) -> _F64:
    """Return lengths along the road at which a border is drawn: every metre, and each break."""
    of_lanes = [section_m + (lane.border or lane.width).starts for lane in lanes]
    known = np.concatenate([line.breaks, *of_lanes])
    inside = known[(known > start + _SHORTEST_M) & (known < end - _SHORTEST_M)]
    even = np.linspace(start, end, int(np.ceil((end - start) / _STEP_M)) + 1)
    lengths: _F64 = np.unique(np.concatenate([even, inside]))
    return lengths
