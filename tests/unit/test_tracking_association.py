"""Equation (1) and its assignment, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from percept.tracking.association import Candidates, assign, pair_costs
from percept.tracking.config import AssociationWeights

_F64 = NDArray[np.float64]
_WEIGHTS = AssociationWeights(
    distance=1.0, size=0.5, overlap=2.0, label=0.3, miss=1.5, gate_sigma=3.0
)
_BOX = [0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]


def _candidates(*boxes: list[float], variance: float = 1.0) -> Candidates:
    spread = np.tile(np.eye(2) * variance, (len(boxes), 1, 1))
    return Candidates(np.array(boxes).reshape(-1, 7), spread)


def _shifted(x: float, **sizes: float) -> list[float]:
    box = _BOX.copy()
    box[0] = x
    box[3], box[4] = sizes.get("length", 4.0), sizes.get("width", 2.0)
    return box


def _costs(tracks: Candidates, seen: Candidates, gate_m: float = 4.0, label: float = 0.0) -> _F64:
    shape = len(tracks.boxes_m), len(seen.boxes_m)
    return pair_costs(tracks, seen, np.full(shape, gate_m), np.full(shape, label), _WEIGHTS)


def _cost(track: Candidates, seen: Candidates, gate_m: float = 4.0, label: float = 0.0) -> float:
    return float(_costs(track, seen, gate_m, label)[0, 0])


def test_the_same_box_costs_nothing() -> None:
    assert _cost(_candidates(_BOX), _candidates(_BOX)) == pytest.approx(0.0, abs=1e-12)


def test_the_four_terms_by_hand() -> None:
    # 1 m of a gate of 4 m; lengths 4 and 3 m; along x they share [-1/2, 2] of [-2, 5/2].
    seen = _shifted(1.0, length=3.0)
    overlap = 2.5 / 4.5  # the hull of two boxes in one line is their union
    expected = 1.0 * 1 / 4 + 0.5 * (0.25 / 3) + 2.0 * (1 - overlap) / 2 + 0.3 * 2.0
    assert _cost(_candidates(_BOX), _candidates(seen), label=2.0) == pytest.approx(expected)


def test_which_side_is_the_length_does_not_matter() -> None:
    turned = [0.0, 0.0, 0.0, 2.0, 4.0, 1.5, np.pi / 2]
    assert _cost(_candidates(_BOX), _candidates(turned)) == pytest.approx(0.0, abs=1e-9)


def test_gates_in_metres_and_in_standard_deviations() -> None:
    far = _candidates(_shifted(3.9))
    assert np.isfinite(_cost(_candidates(_BOX), far))
    assert np.isinf(_cost(_candidates(_BOX), far, gate_m=3.8))
    # 3.9 m against a spread of 2 * 0.8 m^2 is 3.08 standard deviations.
    assert np.isinf(
        _cost(_candidates(_BOX, variance=0.8), _candidates(_shifted(3.9), variance=0.8))
    )


def test_a_spread_that_is_long_in_one_direction_gates_in_the_other() -> None:
    spread = np.array([[[4.0, 0.0], [0.0, 0.01]]])
    track = Candidates(np.array([_BOX]), spread)
    aside = [0.0, 2.0, *_BOX[2:]]
    tight = Candidates(np.array([_shifted(2.0), aside]), spread[[0, 0]])
    finite = np.isfinite(_costs(track, tight, gate_m=9.0))
    assert finite.tolist() == [[True, False]]


def test_no_tracks_or_no_detections() -> None:
    costs = _costs(_candidates(), _candidates(_BOX))
    assert costs.shape == (0, 1)
    assert len(assign(costs, 1.5)[0]) == 0


def test_the_best_total_wins_over_the_best_pair() -> None:
    # Greedy would take (0, 0) for 0.1 and leave 1.4 for the other.
    costs = np.array([[0.1, 0.3], [0.2, 1.4]])
    rows, columns = assign(costs, miss=1.5)
    assert dict(zip(rows.tolist(), columns.tolist(), strict=True)) == {0: 1, 1: 0}


def test_one_good_pair_is_not_given_up_for_two_bad_ones() -> None:
    costs = np.array([[0.1, 1.3], [1.4, np.inf]])
    rows, columns = assign(costs, miss=1.5)
    assert (rows.tolist(), columns.tolist()) == ([0], [0])


@given(arrays(np.float64, (4, 3), elements=st.one_of(st.floats(0, 3), st.just(np.inf))))
def test_every_pair_is_below_a_miss_and_used_once(costs: _F64) -> None:
    rows, columns = assign(costs, miss=1.5)
    assert (costs[rows, columns] < 1.5).all()
    assert len(set(rows)) == len(rows)
    assert len(set(columns)) == len(columns)
    left = np.delete(np.delete(costs, rows, axis=0), columns, axis=1)
    assert not (left < 1.5).any()  # nothing that is worth more than a miss is left over


def test_costs_are_between_each_pair() -> None:
    tracks, seen = _candidates(_BOX, _shifted(1.0)), _candidates(_shifted(1.0), _BOX)
    costs = _costs(tracks, seen)
    assert_allclose(np.diag(costs[:, ::-1]), 0.0, atol=1e-9)
    assert (np.diag(costs) > 0.5).all()
