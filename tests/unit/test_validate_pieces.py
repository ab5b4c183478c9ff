"""Stretches of solid paint, dashes and nothing along a line."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from percept.hdmap.validate.pieces import cut_pieces, runs, without_blips

_STEP_M = 0.5


def _painted(*stretches: tuple[str, float]) -> np.ndarray:
    parts = [np.full(round(length / _STEP_M), mark == "#") for mark, length in stretches]
    return np.concatenate(parts)


def _words(*stretches: tuple[str, float]) -> list[str]:
    return [piece.word for piece in cut_pieces(_painted(*stretches), _STEP_M)]


def test_runs_cover_everything_once() -> None:
    assert [*runs(np.array([1, 1, 0, 2, 2]))] == [(0, 2), (2, 3), (3, 5)]
    assert [*runs(np.array([]))] == []


def test_spots_and_holes_shorter_than_a_dash_are_none() -> None:
    line = _painted(("#", 10), (".", 0.5), ("#", 10))
    assert without_blips(line, _STEP_M).all()
    empty = _painted((".", 10), ("#", 0.5), (".", 10))
    assert not without_blips(empty, _STEP_M).any()


def test_a_long_paint_is_solid_and_a_long_gap_is_nothing() -> None:
    assert _words(("#", 30.0)) == ["solid"]
    assert _words(("#", 30.0), (".", 20.0), ("#", 30.0)) == ["solid", "none", "solid"]
    assert _words(("#", 30.0), (".", 9.0), ("#", 30.0)) == ["solid", "none", "solid"]
    assert _words((".", 40.0)) == ["none"]


def test_regular_short_paints_are_dashes_with_the_gaps_around_them() -> None:
    (piece,) = cut_pieces(_painted((".", 5), *[("#", 3), (".", 9)] * 4), _STEP_M)
    assert (piece.word, piece.first, piece.last) == ("dashed", 0, 106)
    assert piece.sure > 0.9


def test_worn_paint_is_less_sure_to_be_dashes() -> None:
    worn = [("#", 6.0), (".", 1.0), ("#", 2.0), (".", 4.0), ("#", 7.0), (".", 1.5), ("#", 1.0)]
    pieces = cut_pieces(_painted(*worn), _STEP_M)
    assert [piece.word for piece in pieces] == ["dashed"]
    assert pieces[0].sure < 0.5


def test_a_single_spot_in_a_long_gap_is_no_line() -> None:
    assert _words(("#", 20.0), (".", 15.0), ("#", 2.0), (".", 15.0), ("#", 20.0)) == [
        "solid",
        "none",
        "solid",
    ]


@pytest.mark.parametrize("length", [0.5, 3.0, 100.0])
def test_pieces_cover_the_stretch_without_overlap(length: float) -> None:
    rng = np.random.default_rng(3)
    painted = rng.random(max(1, round(length / _STEP_M))) < 0.6
    pieces = cut_pieces(painted, _STEP_M)
    assert pieces[0].first == 0
    assert pieces[-1].last == len(painted)
    assert all(a.last == b.first for a, b in pairwise(pieces))
