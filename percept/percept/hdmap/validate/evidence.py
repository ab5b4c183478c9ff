"""What the sums of one line's stations say: where it is painted, how, and where it lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.lane_markings import Sight
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.pieces import Piece, cut_pieces, runs, without_blips
from percept.hdmap.validate.stations import MapLine
from percept.hdmap.validate.tally import BIN_M, BINS_M, Tally

__all__ = [
    "LineEvidence",
    "joined_runs",
    "line_evidence",
    "reason_unseen",
    "runs_where",
    "sliding_sum",
]

_F64 = NDArray[np.float64]
_Bool = NDArray[np.bool_]

_BRIDGE_M = 2.0
_SHOWS = (0.3, 0.9)
_HALF_WINDOW_M = 6.0
_PEAK_BINS = 4
_LEAST_MASS = 0.3
_FLOOR_SD_M = 0.02
_MOST_INDEPENDENT = 9.0


@dataclass(frozen=True, slots=True, eq=False)
class LineEvidence:
    """One line of the map as it was seen; all arrays are (stations of the line,).

    Attributes:
        line: The line.
        rows: Sums of its stations, as `Tally.rows` gives them.
        known: Whether enough looks saw the place, or those on both sides of it.
        painted: Whether it shows paint.
        duty: Share of the looks, weighted, that saw paint.
        shows: What share paint has where there is some.
        offset_m: Of the paint to the left of the line; NaN where none is near.
        sd_m: Spread of that.
        agreeing: Share of the paint that lies there, and not elsewhere beside the line.
        pieces: Stretches of solid paint, dashes and nothing, of the known stations.
    """

    line: MapLine
    rows: NDArray[np.void]
    known: _Bool
    painted: _Bool
    duty: _F64
    shows: float
    offset_m: _F64
    sd_m: _F64
    agreeing: _F64
    pieces: tuple[Piece, ...]


def line_evidence(
    line: MapLine, tally: Tally, config: ValidationConfig, shift_sd_m: float
) -> LineEvidence:
    """Return what was seen of a line.

    Args:
        line: The line.
        tally: Sums of all stations.
        config: What counts.
        shift_sd_m: Spread of the shift that the looks were corrected by.
    """
    rows = tally.rows(line.stations)
    known = rows["looks"] >= config.looks
    seen, paint = (sliding_sum(rows[name].astype(np.float64), 1) for name in ("seen", "paint"))
    duty = paint / np.maximum(seen, 1e-9)
    shows = _share_where_painted(duty[known])
    judged = rows["passes_on"] + rows["passes_off"]
    refuted = (rows["passes_off"] >= rows["passes_on"]) & (judged >= 2)
    painted = known & (duty > 0.5 * shows) & ~refuted
    known, painted = _bridged(known, painted, line.step_m)
    for first, last in runs_where(known):
        painted[first:last] = without_blips(painted[first:last], line.step_m)
    offset, sd, agreeing = _offsets(rows, painted, line.step_m, shift_sd_m)
    pieces = [
        Piece(first + piece.first, first + piece.last, piece.word, piece.sure)
        for first, last in runs_where(known)
        for piece in cut_pieces(painted[first:last], line.step_m)
    ]
    return LineEvidence(
        line, rows, known, painted, duty, shows, offset, sd, agreeing, tuple(pieces)
    )


def _share_where_painted(duty: _F64) -> float:
    """Return in which share of the looks paint is seen where there is some."""
    if not len(duty):
        return _SHOWS[0]
    high = duty[duty > 0.5 * np.quantile(duty, 0.9)]
    return float(np.clip(np.median(high) if len(high) else 0.0, *_SHOWS))


def runs_where(flags: _Bool) -> list[tuple[int, int]]:
    """Return first and one past the last index of each run of True in (N,)."""
    return [(first, last) for first, last in runs(flags) if flags[first]]


def joined_runs(flags: _Bool, known: _Bool, gap: float) -> list[tuple[int, int]]:
    """Return the runs of True, joined where at most so many known stations lie between them.

    What was not seen between two stretches does not make them two.
    """
    joined: list[tuple[int, int]] = []
    for first, last in runs_where(flags):
        if joined and np.count_nonzero(known[joined[-1][1] : first]) <= gap:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined


def sliding_sum(values: _F64, half: int) -> _F64:
    """Return sums over up to `half` neighbours on each side, along the first axis of (N, ...)."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    at = np.arange(len(values))
    summed: _F64 = total[np.minimum(at + half + 1, len(values))] - total[np.maximum(at - half, 0)]
    return summed


def _bridged(known: _Bool, painted: _Bool, step_m: float) -> tuple[_Bool, _Bool]:
    """Give short stretches that were not seen the paint of what lies before them."""
    known, painted = known.copy(), painted.copy()
    for first, last in [*runs(known)]:
        inner = first > 0 and last < len(known)
        if inner and not known[first] and (last - first) * step_m <= _BRIDGE_M:
            painted[first:last] = painted[first - 1] & painted[last]
            known[first:last] = True
    return known, painted


def _offsets(
    rows: NDArray[np.void], painted: _Bool, step_m: float, shift_sd_m: float
) -> tuple[_F64, _F64, _F64]:
    """Return offset, spread and agreeing share of the paint within 6 m along of each station.

    The highest peak of the summed histogram counts, so that other paint beside the line does
    not draw the offset to itself.
    """
    half = round(_HALF_WINDOW_M / step_m)
    sums = sliding_sum(rows["offsets"] * painted.astype(np.float64)[:, None], half)
    padded = np.pad(sums, ((0, 0), (1, 1)))
    peak = (padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]).argmax(axis=1)
    near = np.abs(np.arange(len(BINS_M)) - peak[:, None]) <= _PEAK_BINS
    mass, total = np.where(near, sums, 0.0).sum(axis=1), sums.sum(axis=1)
    has = total > _LEAST_MASS
    safe = np.maximum(mass, 1e-9)
    offset = np.where(has, (np.where(near, sums, 0.0) @ BINS_M) / safe, np.nan)
    paint = sliding_sum(rows["paint"] * painted.astype(np.float64), half)
    each = sliding_sum(rows["sd"] * painted.astype(np.float64), half) / np.maximum(paint, 1e-9)
    looks = sliding_sum(rows["looks"].astype(np.float64), half) / (2 * half + 1)
    independent = np.clip(looks / 4, 1.0, _MOST_INDEPENDENT)
    sd = np.sqrt(_FLOOR_SD_M**2 + (BIN_M**2) / 12 + shift_sd_m**2 + each**2 / independent)
    return offset, np.where(has, sd, np.nan), np.where(has, mass / np.maximum(total, 1e-9), 0.0)


def reason_unseen(sights: NDArray[np.int32]) -> str:
    """Return why places whose looks by `Sight` are (N, 5) were not seen.

    Every place is out of view or far for most of a drive; where something hid it, or it was
    too dark, that is the reason why no look ever saw it.
    """
    total = sights.sum(axis=0)
    reason = max((Sight.OCCLUDED, Sight.TOO_DARK), key=lambda sight: int(total[sight]))
    if not total[reason]:
        reason = Sight.TOO_FAR if total[Sight.TOO_FAR] else Sight.OUT_OF_VIEW
    return reason.name.lower().replace("_", " ")
