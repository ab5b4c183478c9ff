"""Lines of the map that are gone, moved, repainted or recoloured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from percept.core.map_findings import Discrepancy, Kind
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.evidence import LineEvidence, joined_runs, sliding_sum
from percept.hdmap.validate.findings import Reporter, chance_beyond, looks_factor
from percept.hdmap.validate.pieces import LONGEST_GAP_M, Piece, cut_pieces
from percept.hdmap.validate.tally import BINS_M

__all__ = ["line_findings", "shortest_length", "shows_line"]

_F64 = NDArray[np.float64]

_TWO_DASHES_M = 26.0
_DASHED_M = 16.0
_DASH_QUANTILE = 0.85  # paint of dashes is more than this leaves, a crack is less
_DASHES_M = 20.0
_SOLID_PAINT, _DASHED_PAINT = 0.5, 0.12
_LEAST_LENGTH_M = 5.0
_JOIN_M = 6.0
_COLOUR_HALF_M = 8.0
_LEAST_COLOUR = 1.0
_PAIR_SHOWS = (0.4, 0.9)
_LEAST_COUNTED = 0.3
_COUNTED_SHARE = 0.5
_SIDE_M = 0.04
_LEAST_GAPS = 0.3
_FAINT = 0.4
_WORN = 0.3
_WORN_TRUST = 0.5


def line_findings(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig, legible: float
) -> Iterator[Discrepancy]:
    """Return the findings about one line.

    Args:
        seen: What was seen of it.
        reporter: Makes the findings.
        config: What counts.
        legible: 0..1, how well paint shows in these drives at all.
    """
    yield from _missing(seen, reporter, config, legible)
    yield from _moved(seen, reporter, config)
    yield from _retyped(seen, reporter, config)
    yield from _recoloured(seen, reporter, config)


def shortest_length(length_m: float, config: ValidationConfig) -> float:
    """Return how long a finding about a line of some length must be."""
    return min(config.shortest_m, max(_LEAST_LENGTH_M, 0.9 * length_m))


def shows_line(seen: LineEvidence, span: tuple[int, int]) -> bool:
    """Tell whether a stretch has as much paint as a line has: a spot or a crack is none.

    Args:
        seen: What was seen of the line.
        span: First and one past the last station of the stretch, counted from the line's first.
    """
    share = float(seen.painted[span[0] : span[1]].mean())
    if not seen.line.marking.type.startswith("dashed") and share >= _SOLID_PAINT:
        return True
    length = (span[1] - span[0]) * seen.line.step_m
    long_enough = length >= min(_DASHES_M, 0.9 * seen.line.length_m)
    return long_enough and share >= _DASHED_PAINT


def _words(seen: LineEvidence) -> str:
    marking = seen.line.marking
    parts = [word for word in (marking.colour, marking.type) if word != "unknown"]
    return " ".join([*parts, "line"])


def _missing(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig, legible: float
) -> Iterator[Discrepancy]:
    need = _shortest_gap(seen, config)
    empty = np.zeros(len(seen.known), dtype=bool)
    for piece in seen.pieces:
        empty[piece.first : piece.last] = piece.word == "none"
    for first, last in joined_runs(empty, seen.known, 0):
        chosen = np.arange(first, last)[empty[first:last]]
        length = len(chosen) * seen.line.step_m
        if length < need:
            continue
        share = float(np.mean(seen.duty[chosen])) / seen.shows
        on, off = _visits(seen.rows[chosen])
        contradicted = on > 0 and on / max(on + off, 1) > 0.2
        if share > config.duty_missing and not contradicted:
            continue
        sure = legible * looks_factor(float(np.median(seen.rows["looks"][chosen])))
        sure *= 1.0 - np.exp(-length / (0.4 * need))
        words = "no paint"
        if contradicted:
            sure *= off / (on + off)
            words += f" on {off} of {on + off} visits, paint on the others"
        else:
            sure *= 1.0 - 0.5 * min(share / config.duty_missing, 1.0) ** 2
        yield reporter.on_line(
            Kind.MISSING_ON_ROAD,
            seen.line,
            (first, last),
            seen.rows,
            confidence=sure,
            expected=_words(seen),
            observed=f"{words} over {length:.0f} m",
        )


def _shortest_gap(seen: LineEvidence, config: ValidationConfig) -> float:
    """Return from which length on no paint is a line that is gone, and no gap of its dashes."""
    need = shortest_length(seen.line.length_m, config)
    if seen.line.marking.type.startswith("dashed"):
        whole = max(LONGEST_GAP_M, 0.9 * seen.line.length_m)
        need = max(need, min(_TWO_DASHES_M, whole))
    return need


def _visits(rows: NDArray[np.void]) -> tuple[int, int]:
    """Return how many visits of a stretch saw paint of it, and how many saw none."""
    on = int(np.quantile(rows["passes_on"], _DASH_QUANTILE))
    judged = int(np.quantile(rows["passes_on"] + rows["passes_off"], _DASH_QUANTILE))
    return on, judged - on


def _moved(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig
) -> Iterator[Discrepancy]:
    limit = np.maximum(config.tolerance_m, 3 * seen.sd_m)
    with np.errstate(invalid="ignore"):
        is_off = (np.abs(seen.offset_m) > limit) & seen.known
    need = shortest_length(seen.line.length_m, config)
    for side in (-1.0, 1.0):
        flags = is_off & (np.sign(seen.offset_m) == side)
        for first, last in joined_runs(flags, seen.known, _JOIN_M / seen.line.step_m):
            if (last - first) * seen.line.step_m < need:
                continue
            finding = _moved_stretch(seen, reporter, config, (first, last))
            if finding is not None:
                yield finding


def _moved_stretch(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig, span: tuple[int, int]
) -> Discrepancy | None:
    if not shows_line(seen, span):
        return None
    part = slice(*span)
    painted = seen.painted[part]
    offset = float(np.nanmedian(seen.offset_m[part]))
    sd = float(np.nanmedian(seen.sd_m[part]))
    rows = seen.rows[part][painted]
    on, away = int(rows["passes_on"].max()), int(np.median(rows["passes_away"]))
    sure = chance_beyond(offset, config.tolerance_m, sd) * looks_factor(
        float(np.median(rows["looks"]))
    )
    agreeing = float(np.mean(seen.agreeing[part]))
    sure *= agreeing if away < on else float(np.clip((agreeing - 0.4) / 0.4, 0.0, 1.0))
    side = "left" if offset > 0 else "right"
    words = f"{abs(offset):.2f} m to the {side} of the map's line"
    if away < on:
        sure *= max(away, 0.5) / on
        words += f" on {away} of {on} visits, in place on the others"
    return reporter.on_line(
        Kind.MOVED,
        seen.line,
        span,
        seen.rows,
        confidence=sure,
        expected=f"{_words(seen)} where the map has it",
        observed=words,
        offset_m=offset,
        sd_m=sd,
    )


def _retyped(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig
) -> Iterator[Discrepancy]:
    expected = seen.line.marking.type
    if expected == "unknown":
        return
    need = shortest_length(seen.line.length_m, config)
    for piece, word, sure in _joined_types(seen):
        length = (piece.last - piece.first) * seen.line.step_m
        is_dashed = "dashed" in f"{word} {expected}"
        least = max(need, min(_DASHED_M, 0.9 * seen.line.length_m)) if is_dashed else need
        if word == expected or length < least:
            continue
        looks = float(np.median(seen.rows["looks"][piece.first : piece.last]))
        yield reporter.on_line(
            Kind.TYPE,
            seen.line,
            (piece.first, piece.last),
            seen.rows,
            confidence=sure * looks_factor(looks) * (1.0 - np.exp(-length / (0.5 * need))),
            expected=expected,
            observed=f"{word} over {length:.0f} m",
        )


def _joined_types(seen: LineEvidence) -> list[tuple[Piece, str, float]]:
    """Return stretches of paint with their types and how sure those are."""
    joined: list[tuple[Piece, str, float]] = []
    told = seen.known.copy()
    for piece, word, sure in chain.from_iterable(_types_of(seen, one) for one in seen.pieces):
        if word == "unknown":
            told[piece.first : piece.last] = False
            continue
        if joined and joined[-1][1] == word:
            before, _, sure_before = joined[-1]
            between = np.count_nonzero(told[before.last : piece.first])
            if between * seen.line.step_m <= _JOIN_M:
                sizes = before.last - before.first, piece.last - piece.first
                mean = float(np.average([sure_before, sure], weights=sizes))
                joined[-1] = replace(before, last=piece.last), word, mean
                continue
        joined.append((piece, word, sure))
    return joined


def _types_of(seen: LineEvidence, piece: Piece) -> Iterator[tuple[Piece, str, float]]:
    """Return the stretches of a piece with their types in the words of maps.

    Where solid paint is a pair with gaps like those of dashes, one line of it is dashed.
    """
    if piece.word == "none":
        return
    part = slice(piece.first, piece.last)
    sure = piece.sure
    if piece.word == "dashed":
        contrast = _contrast(seen, part)
        sure *= contrast
        if contrast < _WORN:
            piece, sure = replace(piece, word="solid"), _WORN_TRUST
    pair, single = (
        sliding_sum(seen.rows[part][name].astype(np.float64), 1) for name in ("pair", "single")
    )
    counted = pair + single
    if np.mean(counted > _LEAST_COUNTED) < (_COUNTED_SHARE if piece.word == "solid" else 0.0):
        is_one = "_" not in seen.line.marking.type
        yield piece, piece.word if is_one else "unknown", sure if is_one else 0.0
    elif piece.word == "dashed":
        is_one = float(pair.sum()) < _PAIR_SHOWS[0] * max(float(counted.sum()), 1e-9)
        yield piece, "dashed" if is_one else "unknown", sure
    else:
        yield from _solid_types(seen, piece, sure, pair / np.maximum(counted, 1e-9))


def _solid_types(
    seen: LineEvidence, piece: Piece, sure: float, share: _F64
) -> Iterator[tuple[Piece, str, float]]:
    """Return the types within solid paint, of which a share (N,) of the looks saw a pair."""
    shows = float(np.clip(np.quantile(share, 0.9), *_PAIR_SHOWS))
    paired = share > 0.5 * shows
    for inner in cut_pieces(paired, seen.line.step_m):
        outer = Piece(piece.first + inner.first, piece.first + inner.last, "solid")
        if inner.word == "dashed":
            yield outer, *_dashes_beside(seen, outer, paired[inner.first : inner.last], inner)
            continue
        clear = np.minimum(1.0, 3 * np.abs(share[inner.first : inner.last] / shows - 0.5))
        word = "solid" if inner.word == "none" else "solid_solid"
        yield outer, word, sure * inner.sure * float(np.mean(clear))


def _contrast(seen: LineEvidence, part: slice) -> float:
    """Return how empty the gaps of a piece are, 0..1: between dashes nothing is ever seen."""
    gaps = ~seen.painted[part]
    if not gaps.any():
        return 1.0
    share = gaps.mean()
    worn = 1.0 if share > _LEAST_GAPS else float(share / _LEAST_GAPS)
    empty = 1.0 - float(np.mean(seen.duty[part][gaps])) / (_FAINT * seen.shows)
    return worn * max(empty, 0.0)


def _dashes_beside(
    seen: LineEvidence, outer: Piece, paired: NDArray[np.bool_], inner: Piece
) -> tuple[str, float]:
    """Tell on which side of a solid line dashes lie: between them only the solid one is left."""
    rows = seen.rows[outer.first : outer.last]
    side = _mean_offset(rows[~paired]) - _mean_offset(rows[paired])
    if abs(side) < _SIDE_M:
        return "unknown", 0.0
    return "solid_dashed" if side > 0 else "dashed_solid", inner.sure


def _mean_offset(rows: NDArray[np.void]) -> float:
    sums = rows["offsets"].sum(axis=0)
    return float(sums @ BINS_M / max(float(sums.sum()), 1e-9))


def _recoloured(
    seen: LineEvidence, reporter: Reporter, config: ValidationConfig
) -> Iterator[Discrepancy]:
    expected = seen.line.marking.colour
    if expected not in ("white", "yellow"):
        return
    half = round(_COLOUR_HALF_M / seen.line.step_m)
    painted = np.where(seen.painted, 1.0, 0.0)
    votes = sliding_sum(seen.rows["colour"] * painted, half)
    share = sliding_sum(seen.rows["yellow"] * painted, half) / np.maximum(votes, 1e-9)
    other = share if expected == "white" else 1.0 - share
    flags = (other > 0.5) & (votes > _LEAST_COLOUR) & seen.known
    need = shortest_length(seen.line.length_m, config)
    for first, last in joined_runs(flags, seen.known, _JOIN_M / seen.line.step_m):
        length = (last - first) * seen.line.step_m
        part = float(np.average(other[first:last], weights=votes[first:last] + 1e-9))
        if length < need or part < config.colour_share or not shows_line(seen, (first, last)):
            continue
        looks = float(np.median(seen.rows["looks"][first:last]))
        yield reporter.on_line(
            Kind.COLOUR,
            seen.line,
            (first, last),
            seen.rows,
            confidence=looks_factor(looks) * part * (1.0 - np.exp(-length / (0.5 * need))),
            expected=expected,
            observed=f"{'yellow' if expected == 'white' else 'white'} over {length:.0f} m "
            f"({100 * part:.0f} % of the votes)",
        )
