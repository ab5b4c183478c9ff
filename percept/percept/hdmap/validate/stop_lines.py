"""Bars of paint across the road, summed up by the map's stop lines or in places of their own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.core.lane_markings import GroundCoverage, PaintObservation, Sight
from percept.core.polyline import along_m, points_at
from percept.hdmap.elements import Lanelet, MapMarking
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.look import Placed
from percept.hdmap.validate.tally import PLACE, Moment, begin_passes, note_best

__all__ = ["BAR_BINS_M", "BarTable", "StopLineTally", "lane_directions"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

BAR_BINS_M = np.arange(-100, 101) * 0.05
"""Middles of the bins of offsets along the lane."""

_AGREE = np.cos(np.radians(25.0))
_ALONG_LANE = np.cos(np.radians(50.0))
_OVERLAP = 0.4
_SAMPLES = np.linspace(0.1, 0.9, 5)[:, None]
_SAME_BAR_M = 1.5
_SLACK_M = 3.0
_LEAST_SD_M = 0.1
_LANE_REACH_M = 4.0

_ROW = np.dtype([
    *PLACE.descr,
    ("sights", np.int32, len(Sight)), ("offsets", np.float64, len(BAR_BINS_M)),
    ("bars", np.int32), ("weight", np.float64), ("sd", np.float64), ("width", np.float64),
    ("passes_on", np.int32), ("pass_bars", np.int32),
])  # fmt: skip


class BarTable:
    """Places of bars, and what was seen of each.

    Attributes:
        ends: (N, 2, 2) float64 ends in the map frame.
        forward: (N, 2) float64 unit vectors in the direction of the lane.
        rows: (N,) structured: `looks` saw the place, `bars` of them a bar; `offsets` are
            weights by `BAR_BINS_M`, `sights` looks by `Sight`, `weight`, `sd` and `width` sums.
    """

    def __init__(self, ends: _F64, forward: _F64) -> None:
        self.ends = ends
        self.forward = forward
        self.rows = np.zeros(len(ends), dtype=_ROW)

    @property
    def middles(self) -> _F64:
        """(N, 2) float64 middles."""
        middles: _F64 = self.ends.mean(axis=1)
        return middles

    def normals(self, heading: _F64 | None = None) -> _F64:
        """Return unit vectors (N, 2) square to the bars, in the direction of their lanes.

        Args:
            heading: (2,) unit vector that stands in for lanes that are not known; None leaves
                the normals of their bars as they come.
        """
        across = self.ends[:, 1] - self.ends[:, 0]
        across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        normals = np.stack([-across[:, 1], across[:, 0]], axis=1)
        forward = self.forward if heading is None else self.forward_or(heading)
        ahead = (normals * forward).sum(axis=1, keepdims=True)
        turned: _F64 = np.where(ahead < 0, -normals, normals)
        return turned

    def forward_or(self, heading: _F64) -> _F64:
        """Return the lanes' directions (N, 2); a heading (2,) where none is known."""
        forward: _F64 = np.where(np.isnan(self.forward), heading, self.forward)
        return forward

    def append(self, ends: _F64, forward: _F64) -> int:
        """Add a place and return its row."""
        self.ends = np.concatenate([self.ends, ends[None]])
        self.forward = np.concatenate([self.forward, forward[None]])
        self.rows = np.concatenate([self.rows, np.zeros(1, dtype=_ROW)])
        return len(self.rows) - 1

    def note(self, row: int, offset_m: float, sd_m: float, width_m: float) -> None:
        """Add one bar at a place."""
        sums, weight = self.rows, 1.0 / (_LEAST_SD_M**2 + sd_m**2)
        place = int(np.argmin(np.abs(BAR_BINS_M - offset_m)))
        sums["offsets"][row, place] += weight
        sums["bars"][row] += 1
        sums["pass_bars"][row] += 1
        sums["weight"][row] += weight
        sums["sd"][row] += weight * sd_m
        sums["width"][row] += weight * width_m

    def look_at(
        self, placed: Placed, coverage: GroundCoverage, moment: Moment, config: ValidationConfig
    ) -> None:
        """Count for each place near the vehicle whether this look saw it."""
        reach = config.stop_line_range_m
        apart = np.linalg.norm(self.middles - placed.position, axis=1)
        near = np.flatnonzero(apart < 3 * reach)
        if not len(near):
            return
        samples = self.ends[near, :1] + _SAMPLES * (self.ends[near, 1:] - self.ends[near, :1])
        base = placed.to_base(samples.reshape(-1, 2))
        sights = coverage.at(base).reshape(len(near), -1)
        range_m = np.linalg.norm(base, axis=1).reshape(sights.shape).min(axis=1)
        common = np.array([np.bincount(row, minlength=len(Sight)).argmax() for row in sights])
        common[(common == Sight.SEEN) & (range_m > reach)] = Sight.TOO_FAR
        self.rows["sights"][near, common] += 1
        seen = near[common == Sight.SEEN]
        fresh = begin_passes(self.rows, seen, moment, round(config.pass_gap_s * 1e9))
        self.close(fresh)
        note_best(self.rows, seen, range_m[common == Sight.SEEN], moment)
        self.rows["looks"][seen] += 1

    def close(self, rows: _I64) -> None:
        """Count the visits that rows had, and begin others."""
        self.rows["passes_on"][rows] += self.rows["pass_bars"][rows] > 0
        self.rows["pass_bars"][rows] = 0


class StopLineTally:
    """Sums for each stop line of the map, and for bars that belong to none.

    Attributes:
        markings: The stop lines of the map.
        known: What was seen of them, in their order.
        others: Bars that the map does not have.

    Args:
        markings: The stop lines of the map.
        lanelets: Of the map, which say which way traffic goes at a stop line.
        config: What counts.
    """

    def __init__(
        self,
        markings: Sequence[MapMarking],
        lanelets: Mapping[int, Lanelet],
        config: ValidationConfig,
    ) -> None:
        self._config = config
        self.markings = tuple(markings)
        ends = np.array([m.points_map[[0, -1], :2] for m in markings]).reshape(-1, 2, 2)
        self.known = BarTable(ends, lane_directions(ends, lanelets))
        self.others = BarTable(np.zeros((0, 2, 2)), np.zeros((0, 2)))

    def add(
        self,
        look: PaintObservation,
        placed: Placed,
        ignored: cKDTree,
        moment: Moment,
        dropped: Counter[str],
    ) -> None:
        """Add the bars of one look.

        Args:
            look: The look.
            placed: Where it was made.
            ignored: Places, (N, 2) in the map frame, beside which bars are no stop lines.
            moment: Of the look.
            dropped: What is left out is counted here.
        """
        self.known.look_at(placed, look.coverage, moment, self._config)
        bars = np.concatenate([look.bars_m, np.zeros((len(look.bars_m), 2, 1))], axis=2)
        finite = np.isfinite(bars).all(axis=(1, 2)) & np.isfinite(look.bar_sd_m)
        near = np.zeros(len(bars), dtype=bool)
        middles = bars[finite].mean(axis=1)[:, :2]
        limit = self._config.stop_line_range_m + _SLACK_M
        near[finite] = np.linalg.norm(middles, axis=1) <= limit
        if (~near).any():
            dropped["bars too far away to judge by"] += int((~near).sum())
        ends = placed.to_map(bars[near].reshape(-1, 3))[:, :2].reshape(-1, 2, 2)
        for bar, sd, width in zip(ends, look.bar_sd_m[near], look.bar_width_m[near], strict=True):
            if not self._matched(bar, float(sd), float(width), placed):
                self._unmatched(bar, float(sd), float(width), placed, ignored, dropped)
        self.others.look_at(placed, look.coverage, moment, self._config)

    def finish(self) -> None:
        """Count the visits that are still open."""
        for table in (self.known, self.others):
            table.close(np.arange(len(table.rows)))

    def _matched(self, bar: _F64, sd_m: float, width_m: float, placed: Placed) -> bool:
        """Add a bar to the nearest stop line of the map that it can be, if there is one."""
        table, gate = self.known, self._config.stop_line_gate_m
        offset = _offsets_along(bar, table, placed)
        facing = np.where(table.forward_or(placed.heading) @ placed.heading < 0, width_m, 0.0)
        offset = offset - facing
        fits = _same_bar(bar, table, gate + width_m) & (np.abs(offset) <= gate)
        if not fits.any():
            return False
        row = int(np.argmin(np.where(fits, np.abs(offset), np.inf)))
        table.note(row, float(offset[row]), sd_m, width_m)
        return True

    def _unmatched(
        self,
        bar: _F64,
        sd_m: float,
        width_m: float,
        placed: Placed,
        ignored: cKDTree,
        dropped: Counter[str],
    ) -> None:
        if ignored.n and ignored.query(bar.mean(axis=0))[0] < _SLACK_M:
            dropped["bars on crosswalks"] += 1
            return
        table = self.others
        offset = _offsets_along(bar, table, placed)
        fits = _same_bar(bar, table, _SAME_BAR_M) & (np.abs(offset) <= _SAME_BAR_M)
        if fits.any():
            row = int(np.argmin(np.where(fits, np.abs(offset), np.inf)))
        else:
            row = table.append(bar, placed.heading)
            offset = np.append(offset, 0.0)
        table.note(row, float(offset[row]), sd_m, width_m)


def lane_directions(ends: _F64, lanelets: Mapping[int, Lanelet]) -> _F64:
    """Return the direction (N, 2) of traffic at bars (N, 2, 2); NaN where no lane crosses one."""
    found = np.full((len(ends), 2), np.nan)
    shares = np.linspace(0, 1, 11)
    paths = [
        (_resampled(lanelet.left_map, shares) + _resampled(lanelet.right_map, shares)) / 2
        for lanelet in lanelets.values()
        if len(lanelet.left_map) > 1 and len(lanelet.right_map) > 1
    ]
    if not paths or not len(ends):
        return found
    points = np.concatenate(paths)
    along = np.concatenate([np.gradient(path, axis=0) for path in paths])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = ends[:, 1] - ends[:, 0]
    across = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    reach = _LANE_REACH_M + np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    for row, near in enumerate(cKDTree(points).query_ball_point(ends.mean(axis=1), reach)):
        crossing = [k for k in near if abs(along[k] @ across[row]) < _ALONG_LANE]
        if crossing:
            apart = points[crossing] - ends[row].mean(axis=0)
            found[row] = along[crossing[int(np.linalg.norm(apart, axis=1).argmin())]]
    return found


def _resampled(border: _F64, shares: _F64) -> _F64:
    """Return the places (N, 2) of a border (K, 3) at shares (N,) of its length."""
    return points_at(border[:, :2], shares * along_m(border)[-1])


def _offsets_along(bar: _F64, table: BarTable, placed: Placed) -> _F64:
    """Return how far (N,) a bar (2, 2) lies beyond each place, in the direction of its lane."""
    apart = bar.mean(axis=0) - table.middles
    offsets: _F64 = (apart * table.normals(placed.heading)).sum(axis=1)
    return offsets


def _same_bar(bar: _F64, table: BarTable, reach_m: float) -> NDArray[np.bool_]:
    """Return which places (N,) a bar (2, 2) is beside: it has their direction, and overlaps."""
    across = table.ends[:, 1] - table.ends[:, 0]
    length = np.maximum(np.linalg.norm(across, axis=1), 1e-9)
    across = across / length[:, None]
    along_bar = bar[1] - bar[0]
    bar_length = max(float(np.linalg.norm(along_bar)), 1e-9)
    parallel = np.abs(across @ along_bar) / bar_length > _AGREE
    ends = ((bar[None] - table.ends[:, :1]) * across[:, None]).sum(axis=2)
    shared = np.minimum(ends.max(axis=1), length) - np.maximum(ends.min(axis=1), 0.0)
    near = np.linalg.norm(bar.mean(axis=0) - table.middles, axis=1) < reach_m + length
    same: NDArray[np.bool_] = parallel & near & (shared > _OVERLAP * np.minimum(length, bar_length))
    return same
