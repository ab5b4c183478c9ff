"""Lanes that are wider or narrower than the map has them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.core.map_findings import Discrepancy, Kind
from percept.hdmap.elements import Lanelet
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.evidence import LineEvidence, runs_where
from percept.hdmap.validate.findings import Reporter, chance_beyond, looks_factor
from percept.hdmap.validate.line_findings import shows_line
from percept.hdmap.validate.stations import Stations

__all__ = ["lane_widths"]

_F64 = NDArray[np.float64]

_WIDEST_M = 8.0
_BESIDE_M = 1.0  # along the lane, from a station to that of the other border that is nearest


@dataclass(frozen=True, slots=True, eq=False)
class _Widths:
    """Widths of a lane at the stations (N,) of its left border.

    Attributes:
        map_m: (N,) float64 as the map has it.
        wider_m: (N,) float64 by how much the paint lies further apart; NaN where none is near.
        sd_m: (N,) float64 spread of that.
        opposite: (N,) int64 the station of the right border, counted from its first.
        comparable: (N,) bool whether both borders were seen, and lie beside each other.
    """

    map_m: _F64
    wider_m: _F64
    sd_m: _F64
    opposite: NDArray[np.int64]
    comparable: NDArray[np.bool_]


def lane_widths(
    lanelets: Mapping[int, Lanelet],
    lines: Mapping[int, LineEvidence],
    moved: Sequence[Discrepancy],
    reporter: Reporter,
    config: ValidationConfig,
) -> Iterator[Discrepancy]:
    """Return lanes whose width differs, unless one of their borders is known to have moved.

    Args:
        lanelets: Of the map.
        lines: What was seen, by line string.
        moved: Findings of moved lines.
        reporter: Makes the findings.
        config: What counts.
    """
    explained = {finding.map_element_id for finding in moved}
    for lanelet in lanelets.values():
        for left_id in lanelet.left_ids:
            right_ids = [ident for ident in lanelet.right_ids if ident in lines]
            if left_id not in lines or explained & {left_id, *lanelet.right_ids}:
                continue
            for right_id in right_ids:
                yield from _between(lanelet, lines[left_id], lines[right_id], reporter, config)


def _between(
    lanelet: Lanelet,
    left: LineEvidence,
    right: LineEvidence,
    reporter: Reporter,
    config: ValidationConfig,
) -> Iterator[Discrepancy]:
    widths = _widths(left, right, reporter.stations)
    with np.errstate(invalid="ignore"):
        limit = np.maximum(config.tolerance_m, 3 * widths.sd_m)
        differs = widths.comparable & (np.abs(widths.wider_m) > limit)
    for first, last in runs_where(differs):
        if (last - first) * left.line.step_m < config.shortest_m:
            continue
        opposite = widths.opposite[first:last]
        right_span = int(opposite.min()), int(opposite.max()) + 1
        if not (shows_line(left, (first, last)) and shows_line(right, right_span)):
            continue
        change, spread, width = (
            float(np.median(values[first:last]))
            for values in (widths.wider_m, widths.sd_m, widths.map_m)
        )
        looks = float(np.median(left.rows["looks"][first:last]))
        yield reporter.on_line(
            Kind.LANE_WIDTH,
            left.line,
            (first, last),
            left.rows,
            confidence=chance_beyond(change, config.tolerance_m, spread) * looks_factor(looks),
            expected=f"lanelet {lanelet.lanelet_id} is {width:.2f} m wide",
            observed=f"{width + change:.2f} m between its lines",
            offset_m=change,
            sd_m=spread,
        )


def _widths(left: LineEvidence, right: LineEvidence, stations: Stations) -> _Widths:
    here, there = (stations.points[seen.line.stations, :2] for seen in (left, right))
    distance, opposite = cKDTree(there).query(here)
    facing = stations.tangents[left.line.stations]
    across = there[opposite] - here
    # From the left border the right one lies on the right of the driving direction; each
    # offset counts to the left of its own line's direction.
    sense = np.where(facing[:, 0] * across[:, 1] - facing[:, 1] * across[:, 0] < 0, 1.0, -1.0)
    same = np.sign((stations.tangents[right.line.stations][opposite] * facing).sum(axis=1))
    beside = np.abs((across * facing).sum(axis=1)) < _BESIDE_M
    return _Widths(
        map_m=distance,
        wider_m=sense * (left.offset_m - same * right.offset_m[opposite]),
        sd_m=np.hypot(left.sd_m, right.sd_m[opposite]),
        opposite=opposite,
        comparable=beside & (distance < _WIDEST_M) & left.known & right.known[opposite],
    )
