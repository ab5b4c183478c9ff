"""Which box is which: hand-worked pairs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.datasets.labelling.corrections.box_pairing import (
    BoxColumn,
    ids_agree,
    image_likeness,
    pair_boxes,
    solid_likeness,
)

_Rows = Sequence[tuple[str, int, tuple[float, ...]]]


def _pairs(a: _Rows, b: _Rows) -> list[tuple[int, int]]:
    ours, theirs = _column(a), _column(b)
    likeness = image_likeness(_boxes(a), _boxes(b))
    return pair_boxes(ours, theirs, likeness, same=0.5, least_overlap=0.3)


def _column(rows: _Rows) -> BoxColumn:
    numbers = np.array([number for _, number, _ in rows], np.int64)
    return BoxColumn([label for label, *_ in rows], numbers)


def _boxes(rows: _Rows) -> NDArray[np.float64]:
    return np.array([box for *_, box in rows], np.float64).reshape(-1, 4)


def test_likeness_of_two_boxes() -> None:
    found = image_likeness(
        np.array([[0, 0, 10, 10.0]]), np.array([[5, 0, 15, 11.0], [20, 20, 30, 30]])
    )
    np.testing.assert_allclose(found.iou, [[50 / 160, 0]])
    np.testing.assert_allclose(found.shift, [[5, 20]])


def test_a_box_that_stayed_is_worth_more_than_two_that_overlap() -> None:
    a = [("car", 0, (0, 0, 10, 10)), ("car", 0, (4, 0, 14, 10))]
    b = [("car", 0, (0, 0, 10, 10)), ("car", 0, (-4, 0, 6, 10))]
    assert _pairs(a, b) == [(0, 0)]


def test_renumbered_boxes_stay_where_they_are() -> None:
    a = [("car", 1, (0, 0, 10, 10)), ("car", 2, (3, 0, 13, 10))]
    assert _pairs(a, [("car", 1, (3, 0, 13, 10))]) == [(1, 0)]


def test_a_number_finds_a_box_that_was_dragged_far() -> None:
    a = [("car", 1, (0, 0, 10, 10)), ("car", 2, (50, 0, 60, 10))]
    b = [("truck", 2, (200, 0, 260, 40)), ("car", 0, (1, 0, 11, 10))]
    assert _pairs(a, b) == [(0, 1), (1, 0)]
    assert _pairs([("car", 0, (0, 0, 10, 10))], [("car", 0, (200, 0, 210, 10))]) == []


def test_a_new_class_in_place_wins_against_a_neighbour_of_the_old_one() -> None:
    a = [("car", 0, (0, 0, 10, 10))]
    b = [("car", 0, (5, 0, 15, 10)), ("truck", 0, (0, 0, 10, 10))]
    assert _pairs(a, b) == [(0, 1)]


def test_of_two_equal_boxes_the_class_decides() -> None:
    a = [("truck", 0, (0, 0, 10, 10)), ("car", 0, (0, 0, 10, 10))]
    assert _pairs(a, [("car", 0, (1, 0, 11, 10))]) == [(1, 0)]


@pytest.mark.parametrize("count", [0, 3])
def test_no_boxes_make_no_pairs(count: int) -> None:
    rows = [("car", 1, (0, 0, 1, 1))] * count
    assert _pairs([], rows) == _pairs(rows, []) == []


def test_numbers_agree_until_one_is_in_another_image() -> None:
    assert ids_agree({1: "a", 2: "b"}, {1: "a", 3: "b"})
    assert not ids_agree({1: "a", 2: "b"}, {1: "a", 2: "a"})


def test_the_end_of_a_turned_box_is_what_moved() -> None:
    box = np.array([[10, 0, 0, 8, 2, 2, 3.1]])
    turned = box + np.array([0, 0, 0, 0, 0, 0, 0.1])
    wound = turned - np.array([0, 0, 0, 0, 0, 0, 2 * np.pi])
    np.testing.assert_allclose(solid_likeness(box, turned).shift, [[0.4]])
    np.testing.assert_allclose(solid_likeness(box, wound).shift, [[0.4]])


def test_thin_objects_apart_still_are_alike() -> None:
    cone = np.array([[10, 0, 0, 0.3, 0.3, 0.7, 0.0]])
    found = solid_likeness(cone, cone + np.array([0.5, 0, 0, 0, 0, 0, 0]))
    assert found.iou[0, 0] == 0
    assert found.overlap[0, 0] == 0.75
