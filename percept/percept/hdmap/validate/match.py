"""Which strokes of paint belong to which stations of the map's lines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.validate.stations import STATION_M, Stations

__all__ = ["StrokeMatches", "Votes", "folded", "match_strokes", "nearest_only", "vote"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]
_Bool = NDArray[np.bool_]

_NEIGHBOURS = 8
_AGREE_RAD = np.radians(20.0)
_TWIN_M = 0.15
_ALONG_SLACK = 1.2
_PAIR_M = (0.1, 0.45)
_PAIR_SD_M = 0.1
_WIDE_M = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class StrokeMatches:
    """Pairs of a stroke and a station that it covers; a stroke may have several.

    Attributes:
        stroke: (M,) int64 row of the stroke.
        station: (M,) int64 the station.
        offset_m: (M,) float64 how far it lies to the left of the line, in the line's direction.
        along_m: (M,) float64 how far it lies beyond the station's middle.
        turn_rad: (M,) float64 its direction against the line's, within -pi/2 ... pi/2.
    """

    stroke: _I64
    station: _I64
    offset_m: _F64
    along_m: _F64
    turn_rad: _F64

    def __getitem__(self, chosen: _Bool | _I64) -> StrokeMatches:
        """Return some of the pairs."""
        return StrokeMatches(
            self.stroke[chosen],
            self.station[chosen],
            self.offset_m[chosen],
            self.along_m[chosen],
            self.turn_rad[chosen],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Votes:
    """What one look says of stations at which it shows paint, one row a station.

    Attributes:
        station: (V,) int64, each one once.
        offset_m: (V,) float64 of the paint, for a pair of its middle.
        sd_m: (V,) float64 of that.
        pair: (V,) float64 1 for two lines beside each other, 0 for one, NaN where that cannot
            be told.
        yellow: (V,) float64 0 white ... 1 yellow, NaN where that cannot be told.
        used: (M,) bool of the matches that went in: others are further paint beside the line.
    """

    station: _I64
    offset_m: _F64
    sd_m: _F64
    pair: _F64
    yellow: _F64
    used: _Bool


def match_strokes(
    points: _F64, direction_rad: _F64, stations: Stations, reach_m: float, step_m: float
) -> StrokeMatches:
    """Pair strokes with the stations beside them whose lines have their direction.

    Args:
        points: (N, 2) float64 strokes in the map frame.
        direction_rad: (N,) float64 their directions in the map frame, either way.
        stations: Of the map.
        reach_m: No pair is further apart.
        step_m: Distance along a line for which a stroke stands.
    """
    count = min(_NEIGHBOURS, len(stations))
    distance, near = stations.tree.query(
        points, k=np.arange(1, count + 1), distance_upper_bound=reach_m + STATION_M
    )
    stroke, column = np.nonzero(np.isfinite(distance))
    station = near[stroke, column].astype(np.int64)
    apart = points[stroke] - stations.points[station, :2]
    tangent = stations.tangents[station]
    offset = tangent[:, 0] * apart[:, 1] - tangent[:, 1] * apart[:, 0]
    along = (tangent * apart).sum(axis=1)
    turn = folded(direction_rad[stroke] - np.arctan2(tangent[:, 1], tangent[:, 0]))
    half = max(STATION_M, step_m) / 2 * _ALONG_SLACK
    fits = (np.abs(turn) < _AGREE_RAD) & (np.abs(along) <= half) & (np.abs(offset) <= reach_m)
    return StrokeMatches(stroke.astype(np.int64), station, offset, along, turn)[fits]


def folded(angle_rad: _F64) -> _F64:
    """Return angles between lines that have no direction, within -pi/2 ... pi/2."""
    folded_rad: _F64 = (angle_rad + np.pi / 2) % np.pi - np.pi / 2
    return folded_rad


def nearest_only(matches: StrokeMatches, strokes: int, slack_m: float = _TWIN_M) -> StrokeMatches:
    """Keep of each stroke the nearest line, and lines that lie on it (a border drawn twice)."""
    best = np.full(strokes, np.inf)
    np.minimum.at(best, matches.stroke, np.abs(matches.offset_m))
    return matches[np.abs(matches.offset_m) <= best[matches.stroke] + slack_m]


def vote(matches: StrokeMatches, sd_m: _F64, width_m: _F64, yellow: _F64, step_m: float) -> Votes:
    """Sum up the strokes of each station: paint within 0.45 m is one line or one pair.

    Args:
        matches: Strokes with their stations.
        sd_m: (N,) float64 spreads of all strokes.
        width_m: (N,) float64 their widths.
        yellow: (N,) float64 how yellow they are.
        step_m: Distance along a line for which a stroke stands.
    """
    order = np.lexsort((matches.offset_m, matches.station))
    found = matches[order]
    new_station = np.diff(found.station, prepend=-1) != 0
    step = np.diff(found.offset_m, prepend=0.0)
    group = np.cumsum(new_station | (step > _PAIR_M[1])) - 1
    first = np.flatnonzero(np.diff(group, prepend=-1))
    beside = np.abs(np.diff(found.along_m, prepend=0.0)) < 0.6 * step_m
    paired = beside & (step > _PAIR_M[0]) & (np.diff(group, prepend=-1) == 0)
    if not len(first):
        none = np.zeros(0)
        return Votes(np.zeros(0, np.int64), none, none, none, none, np.zeros(0, bool))
    middle = _middles(found.offset_m, first, paired)
    spread = np.maximum.reduceat(sd_m[found.stroke], first)
    is_pair = np.logical_or.reduceat(paired, first)
    widest = np.maximum.reduceat(width_m[found.stroke], first)
    unclear = (spread > _PAIR_SD_M) | (~is_pair & (widest > _WIDE_M))
    pair = np.where(unclear, np.nan, is_pair.astype(float))
    chosen = _one_a_station(found.station[first], middle)
    used = np.zeros(len(order), dtype=bool)
    used[order] = np.isin(group, chosen)
    return Votes(
        found.station[first][chosen],
        middle[chosen],
        spread[chosen],
        pair[chosen],
        _mean_of_known(yellow[found.stroke], first)[chosen],
        used,
    )


def _middles(offset: _F64, first: _I64, paired: _Bool) -> _F64:
    """Return the mean offset of each group, and of a pair the middle between its two lines."""
    count = np.diff(first, append=len(offset))
    mean = np.add.reduceat(offset, first) / count
    ends = (offset[first] + offset[first + count - 1]) / 2
    middle: _F64 = np.where(np.logical_or.reduceat(paired, first), ends, mean)
    return middle


def _one_a_station(station: _I64, middle: _F64) -> _I64:
    """Return the row of the group of each station that is nearest to the line."""
    order = np.lexsort((np.abs(middle), station))
    first = np.diff(station[order], prepend=-1) != 0
    rows: _I64 = order[first]
    return rows


def _mean_of_known(values: _F64, first: _I64) -> _F64:
    known = np.isfinite(values)
    total = np.add.reduceat(np.where(known, values, 0.0), first)
    count = np.add.reduceat(known.astype(float), first)
    mean: _F64 = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return mean
