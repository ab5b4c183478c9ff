"""Paint that no line of the map accounts for, gathered in cells on the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.validate.tally import PLACE, Moment, begin_passes, note_best

__all__ = ["CELL_M", "UnmatchedPaint"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]

CELL_M = 0.5
"""Side of the cells that strokes are gathered in."""

_START_ROWS = 256
_ROW = np.dtype([
    *PLACE.descr,
    *((name, np.float64) for name in (
        "strokes", "x", "y", "z", "cos2", "sin2", "yellow", "colour", "sd",
    )),
])  # fmt: skip


class UnmatchedPaint:
    """Sums of strokes in square cells, whose grid stands on the map's first line.

    Standing there, the cells do not change where map and poses are moved together.

    Args:
        origin: (2,) float64 a corner of the grid in the map frame.
        axis: (2,) float64 unit vector of one of its axes.
        pass_gap_ns: A place that is seen again after so long is visited again.
    """

    def __init__(self, origin: _F64, axis: _F64, pass_gap_ns: int) -> None:
        self._origin = origin
        self._axes = np.array([axis, [-axis[1], axis[0]]])
        self._pass_gap_ns = pass_gap_ns
        self._row_of: dict[tuple[int, int], int] = {}
        self._table = np.zeros(_START_ROWS, dtype=_ROW)

    def add(
        self,
        points: _F64,
        direction_rad: _F64,
        yellow: _F64,
        sd_m: _F64,
        range_m: _F64,
        moment: Moment,
    ) -> None:
        """Add strokes of one look.

        Args:
            points: (N, 3) float64 in the map frame.
            direction_rad: (N,) float64 in the map frame, either way.
            yellow: (N,) float64 0 white ... 1 yellow; NaN where that cannot be told.
            sd_m: (N,) float64 spreads across.
            range_m: (N,) float64 from the vehicle.
            moment: Of the look.
        """
        places = np.floor((points[:, :2] - self._origin) @ self._axes.T / CELL_M).astype(np.int64)
        cells, first, of = np.unique(places, axis=0, return_index=True, return_inverse=True)
        rows = self._rows_of(cells)
        table = self._table
        begin_passes(table, rows, moment, self._pass_gap_ns)
        note_best(table, rows, range_m[first], moment)
        table["looks"][rows] += 1
        known = np.isfinite(yellow)
        sums = {
            "strokes": np.ones(len(points)), "sd": sd_m,
            "x": points[:, 0] - self._origin[0], "y": points[:, 1] - self._origin[1],
            "z": points[:, 2],
            "cos2": np.cos(2 * direction_rad), "sin2": np.sin(2 * direction_rad),
            "yellow": np.where(known, yellow, 0.0), "colour": known.astype(float),
        }  # fmt: skip
        for name, values in sums.items():
            np.add.at(table[name], rows[of.reshape(-1)], values)

    def rows(self, looks: int) -> NDArray[np.void]:
        """Return the cells that so many looks saw paint in; sums turned into means.

        `x` and `y` are in the map frame, and `yellow` is NaN where no colour was told.
        """
        table: NDArray[np.void] = self._table[: len(self._row_of)]
        table = table[table["looks"] >= looks].copy()
        for name in ("x", "y", "z", "sd"):
            table[name] /= table["strokes"]
        table["x"] += self._origin[0]
        table["y"] += self._origin[1]
        with np.errstate(invalid="ignore"):
            table["yellow"] = table["yellow"] / table["colour"]
        return table

    def _rows_of(self, cells: _I64) -> _I64:
        rows = [self._row_of.setdefault((a, b), len(self._row_of)) for a, b in cells.tolist()]
        while len(self._row_of) > len(self._table):
            self._table = np.concatenate([self._table, np.zeros_like(self._table)])
        return np.array(rows, dtype=np.int64)
