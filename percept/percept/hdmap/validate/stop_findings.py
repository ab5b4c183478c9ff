"""Stop lines that are gone, moved, or not in the map."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy, Kind
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.findings import best_looks, chance_beyond, finding_id, looks_factor
from percept.hdmap.validate.stations import Stations
from percept.hdmap.validate.stop_lines import BAR_BINS_M, BarTable, StopLineTally

__all__ = ["BarSeen", "agreed_along", "bars_seen", "stop_line_findings"]

_F64 = NDArray[np.float64]

_SEEN_SHARE, _GONE_SHARE = 0.3, 0.15
_NEW_SHARE = 0.3
_LEAST_LOOKS = 4  # of a stop line, which a camera sees over a few metres of the way
_LEAST_BARS = 3
_SAME_M = 0.25
_MAJORITY = 0.66
_LEAST_SD_M = 0.05
_INDEPENDENT = 4.0
_ALONG_POSE_SD_M = 0.05
_OFF_MAP_M = 6.0


@dataclass(frozen=True, slots=True)
class BarSeen:
    """A stop line of the map that was seen.

    Attributes:
        row: Its row.
        offset_m: How far it lies beyond the map's along the lane.
        sd_m: Spread of that.
        yaw_rad: Direction of the lane.
        share: Of the looks at it that saw a bar.
    """

    row: int
    offset_m: float
    sd_m: float
    yaw_rad: float
    share: float


def bars_seen(table: BarTable) -> list[BarSeen]:
    """Return the stop lines of the map that were seen."""
    found = []
    normals = table.normals()
    for row, sums in enumerate(table.rows):
        share = float(sums["bars"]) / max(int(sums["looks"]), 1)
        if sums["bars"] < _LEAST_BARS or share < _SEEN_SHARE:
            continue
        forward = normals[row]
        each = float(sums["sd"] / sums["weight"])
        independent = min(float(sums["bars"]), _INDEPENDENT)
        sd = math.sqrt(_LEAST_SD_M**2 + _ALONG_POSE_SD_M**2 + each**2 / independent)
        offset = _peak(sums["offsets"])
        found.append(BarSeen(row, offset, sd, math.atan2(forward[1], forward[0]), min(share, 1.0)))
    return found


def agreed_along(bars: Sequence[BarSeen]) -> list[BarSeen]:
    """Return the stop lines that most of them agree with; none where no majority does."""
    if len(bars) < 2:
        return []
    offsets = np.array([bar.offset_m for bar in bars])
    near = np.abs(offsets[:, None] - offsets) < _SAME_M
    best = int(near.sum(axis=1).argmax())
    if near[best].mean() < _MAJORITY:
        return []
    return [bar for bar, is_near in zip(bars, near[best], strict=True) if is_near]


def stop_line_findings(
    tally: StopLineTally,
    bars: Sequence[BarSeen],
    common_m: float,
    stations: Stations,
    sensors: Sequence[str],
    config: ValidationConfig,
) -> Iterator[Discrepancy]:
    """Return the findings about stop lines.

    Args:
        tally: Of all looks.
        bars: Stop lines of the map that were seen.
        common_m: How far all of them lie beyond the map's: an offset of map or poses.
        stations: Of the painted lines of the map.
        sensors: Names of the sensors by number.
        config: What counts.
    """
    for bar in bars:
        offset = bar.offset_m - common_m
        if abs(offset) > max(config.stop_line_tolerance_m, 3 * bar.sd_m):
            yield _moved(tally, bar, offset, sensors, config)
    for row, sums in enumerate(tally.known.rows):
        share = float(sums["bars"]) / max(int(sums["looks"]), 1)
        if sums["looks"] >= _LEAST_LOOKS and share < _GONE_SHARE:
            yield _missing(tally, row, share, sensors)
    yield from _missing_in_map(tally.others, stations, sensors)


def _moved(
    tally: StopLineTally,
    bar: BarSeen,
    offset: float,
    sensors: Sequence[str],
    config: ValidationConfig,
) -> Discrepancy:
    marking, sums = tally.markings[bar.row], tally.known.rows[bar.row]
    seen = marking.points_map.copy()
    seen[:, :2] += bar.offset_m * tally.known.normals()[bar.row]
    sure = chance_beyond(offset, config.stop_line_tolerance_m, bar.sd_m)
    side = "beyond" if offset > 0 else "before"
    return Discrepancy(
        finding_id=finding_id(Kind.STOP_LINE_MOVED, marking.element_id),
        kind=Kind.STOP_LINE_MOVED,
        map_element_id=marking.element_id,
        along_m=0.0,
        offset_m=offset,
        length_m=_length(marking.points_map),
        sd_m=bar.sd_m,
        observations=int(sums["bars"]),
        visits=int(sums["passes"]),
        confidence=sure * looks_factor(float(sums["bars"])) * min(1.0, bar.share / 0.5),
        expected="a stop line where the map has it",
        observed=f"a bar {abs(offset):.2f} m {side} the map's stop line",
        points_map=seen,
        points_expected_map=marking.points_map,
        looks=best_looks(tally.known.rows[bar.row : bar.row + 1], sensors),
    )


def _missing(tally: StopLineTally, row: int, share: float, sensors: Sequence[str]) -> Discrepancy:
    marking, sums = tally.markings[row], tally.known.rows[row]
    passes, on = int(sums["passes"]), int(sums["passes_on"])
    sure = looks_factor(float(sums["looks"])) * (1.0 - 0.5 * share / _GONE_SHARE)
    return Discrepancy(
        finding_id=finding_id(Kind.STOP_LINE_MISSING, marking.element_id),
        kind=Kind.STOP_LINE_MISSING,
        map_element_id=marking.element_id,
        along_m=0.0,
        offset_m=math.nan,
        length_m=_length(marking.points_map),
        sd_m=math.nan,
        observations=int(sums["looks"]),
        visits=passes,
        confidence=sure,
        expected="a stop line",
        observed="no bar of paint"
        + (f" in {passes - on} of {passes} visits" if 0 < on < passes else ""),
        points_map=marking.points_map,
        points_expected_map=marking.points_map,
        looks=best_looks(tally.known.rows[row : row + 1], sensors),
    )


def _missing_in_map(
    table: BarTable, stations: Stations, sensors: Sequence[str]
) -> Iterator[Discrepancy]:
    if not len(table.rows):
        return
    apart = stations.tree.query(table.middles)[0]
    for row, sums in enumerate(table.rows):
        share = float(sums["bars"]) / max(int(sums["looks"]), 1)
        if sums["bars"] < _LEAST_BARS or share < _NEW_SHARE or apart[row] > _OFF_MAP_M:
            continue
        ends = table.ends[row] + _peak(sums["offsets"]) * table.forward[row]
        height = float(stations.points[stations.tree.query(table.middles[row])[1], 2])
        points = np.column_stack([ends, np.full(2, height)])
        yield Discrepancy(
            finding_id=finding_id(Kind.STOP_LINE_MISSING_IN_MAP, 0, *ends.mean(axis=0)),
            kind=Kind.STOP_LINE_MISSING_IN_MAP,
            map_element_id=0,
            along_m=0.0,
            offset_m=math.nan,
            length_m=_length(points),
            sd_m=float(sums["sd"] / sums["weight"]),
            observations=int(sums["bars"]),
            visits=int(sums["passes"]),
            confidence=looks_factor(float(sums["bars"])) * min(1.0, share / 0.6),
            expected="no stop line",
            observed=f"a bar of {_length(points):.1f} m across the lane",
            points_map=points,
            points_expected_map=np.zeros((0, 3)),
            looks=best_looks(table.rows[row : row + 1], sensors),
        )


def _peak(offsets: _F64) -> float:
    """Return the mean offset around the highest peak of weights by `BAR_BINS_M`."""
    smooth = np.convolve(offsets, np.ones(9), mode="same")
    near = np.abs(BAR_BINS_M - BAR_BINS_M[int(smooth.argmax())]) < 0.5
    return float(np.average(BAR_BINS_M[near], weights=offsets[near] + 1e-12))


def _length(points: _F64) -> float:
    return float(np.linalg.norm(points[-1, :2] - points[0, :2]))
