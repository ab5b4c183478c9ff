"""An OpenDRIVE file as a map: the marks of its lanes are its line strings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.core.geodesy import LocalFrame
from percept.hdmap.coordinates import MapPoints
from percept.hdmap.elements import MapMarking
from percept.hdmap.georeference import Georeference
from percept.hdmap.opendrive.document import Numbers, read_document
from percept.hdmap.opendrive.header import header_offset, read_georeference
from percept.hdmap.opendrive.lanes import MarkedLine, marked_lines
from percept.hdmap.opendrive.road_line import read_road_line

__all__ = ["OpenDriveMap", "is_opendrive", "load_opendrive"]

_F64 = NDArray[np.float64]
_MOST_POINTS = 5_000_000
_LARGEST_M = 1e8
_IGNORED = {
    "signals/signal": "signals, stop lines among them",
    "objects/object": "objects, crosswalks among them",
    "lateralProfile/shape": "shapes of the road across it: the road is taken as flat there",
    "lateralProfile/crossfall": "crossfalls: the road is taken as flat there",
    "lanes/laneSection//height": "heights of lanes over the road",
}


@dataclass(frozen=True, slots=True, eq=False)
class OpenDriveMap:
    """What an OpenDRIVE file says of paint.

    Attributes:
        markings: By number, which are the ids of `points` and lines.
        points: All points of all markings.
        nodes: Ids of the points of each marking.
        origin: As it was given.
        georeference: None where the file does not say where it lies.
        dropped: What it holds and this does not, by reason.
    """

    markings: tuple[MapMarking, ...]
    points: MapPoints
    nodes: tuple[tuple[int, ...], ...]
    origin: LocalFrame | None
    georeference: Georeference | None
    dropped: Counter[str]


def is_opendrive(path: Path) -> bool:
    """Return whether a file is taken as OpenDRIVE, by its suffix."""
    return path.suffix.lower() == ".xodr"


def load_opendrive(path: Path, origin: LocalFrame | None = None) -> OpenDriveMap:
    """Read the lane markings of an OpenDRIVE file.

    Args:
        path: The file.
        origin: East, north and up of what the map is laid: a file with a georeference by it,
            another as it is. None keeps the coordinates of the file.

    Raises:
        InputError: If the file is no OpenDRIVE, holds no roads, or a number in it is none.
    """
    root = read_document(path)
    dropped: Counter[str] = Counter()
    named = _named_lines(root, path, dropped)
    if not named:
        raise InputError("holds no markings of lanes", where=path)
    points, georeference = _placed(root, [line.points_map for _, line in named], path, dropped)
    if origin is not None:
        points = origin.local(georeference.geodetic(points)) if georeference else points
        georeference = Georeference.of_origin(origin)
    ends = np.cumsum([0, *(len(line.points_map) for _, line in named)]).tolist()
    return OpenDriveMap(
        markings=_markings(named, [points[start:end] for start, end in pairwise(ends)]),
        points=MapPoints(np.arange(1, len(points) + 1, dtype=np.int64), points),
        nodes=tuple(tuple(range(start + 1, end + 1)) for start, end in pairwise(ends)),
        origin=origin,
        georeference=georeference,
        dropped=+dropped,
    )


def _named_lines(
    root: etree._Element, path: Path, dropped: Counter[str]
) -> list[tuple[str, MarkedLine]]:
    """Return the marks of all roads with what people call them; count what is not read."""
    named, size = [], 0
    for road in root.iterfind("road"):
        name = f"road {(road.get('id') or 'without an id')[:40]}"
        numbers = Numbers(path, name)
        for line in marked_lines(road, read_road_line(road, numbers), numbers):
            named.append((f"{name} lane {line.lane_id}", line))
            size += len(line.points_map)
            if size > _MOST_POINTS:
                raise numbers.error(f"more than {_MOST_POINTS} points of markings up to here")
            if line.mark.unknown:
                dropped[f"road marks '{line.mark.unknown}', taken as of an unknown type"] += 1
        for place, what in _IGNORED.items():
            dropped[f"{what} (OpenDRIVE)"] += len(road.findall(place))
    return named


def _placed(
    root: etree._Element, shapes: Sequence[_F64], path: Path, dropped: Counter[str]
) -> tuple[_F64, Georeference | None]:
    points = header_offset(root, np.concatenate(shapes), Numbers(path, "header"))
    if not (np.abs(points) <= _LARGEST_M).all():
        raise InputError("a road leaves all bounds: its numbers are too large", where=path)
    return points, read_georeference(root, points, dropped)


def _markings(
    named: Sequence[tuple[str, MarkedLine]], shapes: Sequence[_F64]
) -> tuple[MapMarking, ...]:
    return tuple(
        MapMarking(
            element_id=number,
            kind="line",
            points_map=points_map,
            type=line.mark.type,
            colour=line.mark.colour,
            painted=line.mark.painted,
            width_m=line.mark.width_m,
            name=name,
        )
        for number, ((name, line), points_map) in enumerate(
            zip(named, shapes, strict=True), start=1
        )
    )
