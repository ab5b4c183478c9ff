"""What all looks together say of each station: sums and histograms, never the strokes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import Sight
from percept.hdmap.validate.match import Votes

__all__ = ["BINS_M", "BIN_M", "Moment", "Tally", "begin_passes", "look_weights", "note_best"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]
_U8 = NDArray[np.uint8]
_Rows = NDArray[np.void]

BIN_M = 0.05
"""Width of the bins of offsets."""
BINS_M = (np.arange(40) - 19.5) * BIN_M
"""Middles of the bins of offsets: paint up to 1 m beside its line."""

_HALF_WEIGHT_M = 12.0
_BEST_RANGE_M = 8.0
_NO_IMAGE_M = 1e3
_START_ROWS = 1024
_PASS_LOOKS = 3
_PASS_ON, _PASS_OFF = 0.4, 0.15
_AWAY_M = 0.25

_PLACE_FIELDS = [
    ("last_ns", np.int64), ("last_drive", np.int32), ("passes", np.int32),
    ("best_m", np.float32), ("best_range_m", np.float32), ("best_drive", np.int32),
    ("best_sensor", np.int32), ("best_ns", np.int64),
]  # fmt: skip
PLACE = np.dtype([("looks", np.int32), *_PLACE_FIELDS])
"""Columns that stations, stop lines and cells of unmatched paint have in common."""

_ROW = np.dtype([
    *PLACE.descr,
    ("sights", np.int32, len(Sight)), ("offsets", np.float32, len(BINS_M)),
    *((name, np.float32) for name in (
        "seen", "paint", "pair", "single", "yellow", "colour", "sd",
        "pass_seen", "pass_paint", "pass_offset",
    )),
    ("pass_looks", np.int32), ("passes_on", np.int32), ("passes_off", np.int32),
    ("passes_away", np.int32),
])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Moment:
    """When and by whom a look was made.

    Attributes:
        drive: Number of the drive.
        sensor: Number of the sensor.
        stamp_ns: Time of the look.
        is_image: Whether a picture can be cut from it.
    """

    drive: int
    sensor: int
    stamp_ns: int
    is_image: bool = True


def look_weights(range_m: _F64) -> _F64:
    """Return (N,) weights of looks at ranges (N,): far paint is missed more often."""
    weights: _F64 = 1.0 / (1.0 + (range_m / _HALF_WEIGHT_M) ** 2)
    return weights


def begin_passes(table: _Rows, rows: _I64, moment: Moment, gap_ns: int) -> _I64:
    """Return which rows are visited anew, and note that all of them are visited now."""
    first = table["passes"][rows] == 0
    other = table["last_drive"][rows] != moment.drive
    late = np.abs(moment.stamp_ns - table["last_ns"][rows]) > gap_ns
    fresh: _I64 = rows[first | other | late]
    table["passes"][fresh] += 1
    table["last_ns"][rows] = moment.stamp_ns
    table["last_drive"][rows] = moment.drive
    return fresh


def note_best(table: _Rows, rows: _I64, range_m: _F64, moment: Moment) -> None:
    """Keep the look from nearest to the best distance; an image, if there is one."""
    off = np.abs(range_m - _BEST_RANGE_M) + (0.0 if moment.is_image else _NO_IMAGE_M)
    better = (table["looks"][rows] == 0) | (off < table["best_m"][rows])
    rows, off, range_m = rows[better], off[better], range_m[better]
    table["best_m"][rows], table["best_range_m"][rows] = off, range_m
    table["best_drive"][rows], table["best_sensor"][rows] = moment.drive, moment.sensor
    table["best_ns"][rows] = moment.stamp_ns


class Tally:
    """Sums for each station that the drives came near; a row is made when it is first needed.

    Columns: `seen` and `paint` are weights of looks that saw the place and that saw paint on
    it; `pair` and `single` of those that could count its lines; `yellow` of `colour` of those
    that could tell; `offsets` (40,) weights by `BINS_M`; `sights` (5,) looks by `Sight`;
    `passes` visits, of which `passes_on` saw paint, `passes_off` none, and `passes_away` paint
    beside the line.

    Args:
        stations: How many stations there are.
        pass_gap_ns: A place that is seen again after so long is visited again.
    """

    def __init__(self, stations: int, pass_gap_ns: int) -> None:
        self._pass_gap_ns = pass_gap_ns
        self._row_of = np.full(stations, -1, dtype=np.int64)
        self._used = 0
        self._table: _Rows = np.zeros(_START_ROWS, dtype=_ROW)

    def rows(self, stations: slice | _I64) -> _Rows:
        """Return the sums of stations as a structured array; zeros where no look came near."""
        wanted = self._row_of[stations]
        found = np.zeros(len(wanted), dtype=_ROW)
        found[wanted >= 0] = self._table[wanted[wanted >= 0]]
        return found

    def add(self, stations: _I64, sights: _U8, range_m: _F64, votes: Votes, moment: Moment) -> None:
        """Add one look.

        Args:
            stations: (N,) int64 stations near the vehicle, rising, each once.
            sights: (N,) uint8 of `Sight`.
            range_m: (N,) float64 from the vehicle.
            votes: Of the stations that show paint; those out of sight are not counted.
            moment: Of the look.
        """
        rows = self._rows_of(stations)
        table = self._table
        table["sights"][rows, sights] += 1
        is_seen = sights == Sight.SEEN
        seen, weight = rows[is_seen], look_weights(range_m[is_seen])
        self._close(begin_passes(table, seen, moment, self._pass_gap_ns))
        note_best(table, seen, range_m[is_seen], moment)
        table["looks"][seen] += 1
        table["pass_looks"][seen] += 1
        table["seen"][seen] += weight
        table["pass_seen"][seen] += weight
        _, of_vote, of_seen = np.intersect1d(
            votes.station, stations[is_seen], assume_unique=True, return_indices=True
        )
        self._add_votes(seen[of_seen], weight[of_seen], votes, of_vote)

    def finish(self) -> None:
        """Count the visits that are still open."""
        self._close(np.arange(self._used))

    def _add_votes(self, rows: _I64, weight: _F64, votes: Votes, chosen: _I64) -> None:
        table, offset = self._table, votes.offset_m[chosen]
        bins = np.clip(((offset - BINS_M[0]) / BIN_M + 0.5).astype(np.int64), 0, len(BINS_M) - 1)
        sharp = weight / (1.0 + (votes.sd_m[chosen] / 0.1) ** 2)
        table["offsets"][rows, bins] += sharp
        table["paint"][rows] += weight
        table["sd"][rows] += weight * votes.sd_m[chosen]
        table["pass_paint"][rows] += weight
        table["pass_offset"][rows] += weight * offset
        pair, yellow = votes.pair[chosen], votes.yellow[chosen]
        table["pair"][rows] += np.where(pair > 0, weight, 0)
        table["single"][rows] += np.where(pair == 0, weight, 0)
        known = np.isfinite(yellow)
        table["yellow"][rows] += np.where(yellow > 0.5, weight, 0)
        table["colour"][rows] += np.where(known, weight, 0)

    def _close(self, rows: _I64) -> None:
        """Judge the visits that the rows had, and begin to sum up others."""
        table = self._table
        rows = rows[table["pass_looks"][rows] > 0]
        judged = table["pass_looks"][rows] >= _PASS_LOOKS
        paint = table["pass_paint"][rows]
        duty = paint / np.maximum(table["pass_seen"][rows], 1e-9)
        is_on = judged & (duty > _PASS_ON)
        away = np.abs(table["pass_offset"][rows]) > _AWAY_M * paint
        table["passes_on"][rows] += is_on
        table["passes_away"][rows] += is_on & away
        table["passes_off"][rows] += judged & (duty < _PASS_OFF)
        for name in ("pass_seen", "pass_paint", "pass_offset", "pass_looks"):
            table[name][rows] = 0

    def _rows_of(self, stations: _I64) -> _I64:
        fresh = stations[self._row_of[stations] < 0]
        end = self._used + len(fresh)
        while end > len(self._table):
            self._table = np.concatenate([self._table, np.zeros_like(self._table)])
        self._row_of[fresh] = np.arange(self._used, end)
        self._used = end
        rows: _I64 = self._row_of[stations]
        return rows
