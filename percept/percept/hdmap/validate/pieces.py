"""Stretches of solid paint, of dashes and of nothing along a line.

Dashes of road markings are 1 to 6 m long with gaps of up to 9 m (MUTCD 2023, 3A.04: 10 ft and
30 ft; Vienna Convention rules: 1 to 6 m), so that paint of more than `LONGEST_DASH_M` without
a gap is a solid line, and a gap of more than `LONGEST_GAP_M` is none of dashes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["LONGEST_DASH_M", "LONGEST_GAP_M", "Piece", "cut_pieces", "runs", "without_blips"]

_Bool = NDArray[np.bool_]

LONGEST_DASH_M = 7.5
LONGEST_GAP_M = 13.0

_BLIP_M = 0.75
_REGULAR = 0.25
_UNEVEN = 0.4
_SURE_DASHES = 3
_SPOT = 0.2
_MOST_SURE = 0.99


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of a line with one look of its paint.

    Attributes:
        first: Its first station.
        last: One past its last.
        word: `solid`, `dashed` or `none`.
        sure: 1 for solid paint and nothing; less for dashes: by how many and how regular they
            are, as worn paint is not.
    """

    first: int
    last: int
    word: str
    sure: float = 1.0


def runs(values: NDArray[np.generic]) -> Iterator[tuple[int, int]]:
    """Return first and one past the last index of each run of equal values (N,)."""
    if not len(values):
        return iter(())
    cuts = np.flatnonzero(values[1:] != values[:-1]) + 1
    edges = [0, *cuts.tolist(), len(values)]
    return pairwise(edges)


def without_blips(painted: _Bool, step_m: float) -> _Bool:
    """Return the stations (N,) with holes and spots shorter than the shortest dash removed."""
    cleaned = painted.copy()
    for value in (False, True):
        for first, last in [*runs(cleaned)]:
            inner = first > 0 and last < len(cleaned)
            if inner and cleaned[first] == value and (last - first) * step_m < _BLIP_M:
                cleaned[first:last] = not value
    return cleaned


def cut_pieces(painted: _Bool, step_m: float) -> list[Piece]:
    """Cut a stretch, all of which was looked at, into pieces.

    Args:
        painted: (N,) bool whether each station shows paint.
        step_m: Length of a station.
    """
    cleaned = without_blips(painted, step_m)
    spans = [*runs(cleaned)]
    pieces: list[Piece] = []
    dashes: list[tuple[int, int]] = []
    for first, last in spans:
        length = (last - first) * step_m
        if cleaned[first] and length > LONGEST_DASH_M:
            pieces += [*_dashed(dashes, step_m), Piece(first, last, "solid")]
            dashes = []
        elif cleaned[first]:
            dashes.append((first, last))
        elif length > LONGEST_GAP_M:
            pieces += _dashed(dashes, step_m)
            dashes = []
    pieces += _dashed(dashes, step_m)
    return _with_gaps(_without_spots(_filled(pieces, len(painted)), step_m), step_m)


def _dashed(dashes: list[tuple[int, int]], step_m: float) -> list[Piece]:
    """Return the piece that short paints between two long gaps or long paints make."""
    if len(dashes) < 2:
        return [Piece(first, last, "solid", _SPOT) for first, last in dashes]
    starts = np.diff([first for first, _ in dashes]) * step_m
    # The first and the last one may be cut off by the end of the line or of what was seen.
    lengths = np.array([last - first for first, last in dashes[1:-1] or dashes])
    spread = np.hypot(
        np.std(starts) / np.mean(starts), _UNEVEN * np.std(lengths) / np.mean(lengths)
    )
    regular = 1.0 / (1.0 + (float(spread) / _REGULAR) ** 2)
    enough = min(_MOST_SURE, len(dashes) / _SURE_DASHES)
    return [Piece(dashes[0][0], dashes[-1][1], "dashed", regular * enough)]


def _without_spots(pieces: list[Piece], step_m: float) -> list[Piece]:
    """Take a single short paint far from all other for what it is: no line."""
    kept: list[Piece] = []
    for number, piece in enumerate(pieces):
        beside = pieces[max(number - 1, 0) : number + 2 : 2]
        gaps = [(gap.last - gap.first) * step_m for gap in beside if gap.word == "none"]
        is_spot = piece.sure == _SPOT and len(gaps) == 2 and min(gaps) > LONGEST_GAP_M
        word = "none" if is_spot else piece.word
        if kept and kept[-1].word == word == "none":
            kept[-1] = replace(kept[-1], last=piece.last)
        else:
            kept.append(Piece(piece.first, piece.last, word, 1.0) if is_spot else piece)
    return kept


def _with_gaps(pieces: list[Piece], step_m: float) -> list[Piece]:
    """Give dashes the gaps before and after them, which may be ones of theirs."""
    whole: list[Piece] = []
    for number, piece in enumerate(pieces):
        is_gap = piece.word == "none" and (piece.last - piece.first) * step_m <= LONGEST_GAP_M
        after = pieces[number + 1] if number + 1 < len(pieces) else None
        if is_gap and whole and whole[-1].sure < 1:
            whole[-1] = replace(whole[-1], last=piece.last)
        elif is_gap and after is not None and after.sure < 1:
            pieces[number + 1] = replace(after, first=piece.first)
        else:
            whole.append(piece)
    return whole


def _filled(pieces: list[Piece], count: int) -> list[Piece]:
    """Return the pieces with those of nothing between them."""
    filled: list[Piece] = []
    at = 0
    for piece in [*pieces, Piece(count, count, "none")]:
        if piece.first > at:
            filled.append(Piece(at, piece.first, "none"))
        if piece.last > piece.first:
            filled.append(piece)
        at = piece.last
    return filled
