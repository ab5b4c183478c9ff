"""Lines of a map cut into stations: short pieces that are looked at one by one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.core.polyline import along_m, points_at
from percept.hdmap.elements import MapMarking

__all__ = ["STATION_M", "MapLine", "Stations", "cut_lines", "usable_markings"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

STATION_M = 0.5
"""Length of a station: dashes of 1 m, the shortest in use, fill two."""
_CHORD_M = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class MapLine:
    """A line of the map and its stations.

    Attributes:
        marking: What the map says.
        first: Number of its first station.
        last: One past its last station.
        step_m: Exact length of its stations.
    """

    marking: MapMarking
    first: int
    last: int
    step_m: float

    @property
    def length_m(self) -> float:
        """Length of the line."""
        return (self.last - self.first) * self.step_m

    @property
    def stations(self) -> slice:
        """Where its stations are."""
        return slice(self.first, self.last)


@dataclass(frozen=True, slots=True, eq=False)
class Stations:
    """All stations of a set of lines.

    Attributes:
        lines: The lines.
        points: (N, 3) float64 middles of the stations, map frame.
        tangents: (N, 2) float64 unit directions of the lines there.
        line: (N,) int64 row in `lines`.
        tree: Of x and y of the points.
    """

    lines: tuple[MapLine, ...]
    points: _F64
    tangents: _F64
    line: _I64
    tree: cKDTree

    def __len__(self) -> int:
        return len(self.points)

    @property
    def normals(self) -> _F64:
        """(N, 2) unit vectors to the left of the lines' directions."""
        return np.stack([-self.tangents[:, 1], self.tangents[:, 0]], axis=1)


def usable_markings(
    markings: Sequence[MapMarking], dropped: Counter[str]
) -> tuple[MapMarking, ...]:
    """Return markings with finite points and a length; count the others."""
    found = []
    for marking in markings:
        points = marking.points_map
        if points.ndim != 2 or len(points) < 2 or not np.isfinite(points).all():
            dropped["markings of the map without two finite points"] += 1
        elif np.ptp(points[:, :2], axis=0).max() <= 0:
            dropped["markings of the map without a length"] += 1
        else:
            found.append(marking)
    return tuple(found)


def cut_lines(markings: Sequence[MapMarking]) -> Stations:
    """Cut lines into stations of about `STATION_M`."""
    lines, points, tangents, rows = [], [np.zeros((0, 3))], [np.zeros((0, 2))], [np.zeros(0, int)]
    first = 0
    for row, marking in enumerate(markings):
        path = marking.points_map
        length = float(along_m(path)[-1])
        count = max(1, round(length / STATION_M))
        step = length / count
        middles = step * (np.arange(count, dtype=np.float64) + 0.5)
        points.append(points_at(path, middles))
        chord = points_at(path, middles + _CHORD_M / 2) - points_at(path, middles - _CHORD_M / 2)
        chord_m = np.linalg.norm(chord[:, :2], axis=1, keepdims=True)
        tangents.append(chord[:, :2] / np.maximum(chord_m, 1e-9))
        rows.append(np.full(count, row))
        lines.append(MapLine(marking, first, first + count, step))
        first += count
    stacked = np.concatenate(points)
    return Stations(
        tuple(lines),
        stacked,
        np.concatenate(tangents),
        np.concatenate(rows).astype(np.int64),
        cKDTree(stacked[:, :2]),
    )
