"""Tiles cover the image, and one object is one box whatever tiles it lies in."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from percept.detection.boxes.found import FoundBoxes
from percept.detection.images.tiling import join_regions, regions_of

_SIZE = (1000, 600)


def _found(*boxes: ArrayLike, class_id: int = 0) -> FoundBoxes:
    table = np.array(boxes, dtype=float).reshape(-1, 4)
    return FoundBoxes(table, np.full(len(table), class_id), np.full(len(table), 0.9))


@given(
    st.integers(1, 3000),
    st.integers(1, 3000),
    st.integers(1, 6),
    st.integers(1, 4),
    st.floats(0, 0.8),
)
def test_tiles_cover_the_image(
    width: int, height: int, columns: int, rows: int, overlap: float
) -> None:
    whole, *tiles = regions_of((width, height), (columns, rows), overlap)
    assert whole == (0, 0, width, height)
    assert len(tiles) <= columns * rows
    for spans, length in (([(t[0], t[2]) for t in tiles], width),
                          ([(t[1], t[3]) for t in tiles], height)):  # fmt: skip
        spans = sorted(set(spans)) or [(0, length)]
        assert spans[0][0] == 0
        assert spans[-1][1] == length
        assert all(b[0] <= a[1] for a, b in pairwise(spans))
        assert len({high - low for low, high in spans}) == 1


def test_neighbours_share_what_was_asked_for() -> None:
    _, left, right = regions_of((1000, 600), (2, 1), 0.2)
    assert left == (0, 0, 556, 600)
    assert right == (444, 0, 1000, 600)
    assert (left[2] - right[0]) / 556 == pytest.approx(0.2, abs=0.002)


def _joined(*parts: FoundBoxes) -> list[list[float]]:
    regions = regions_of(_SIZE, (2, 1), 0.2)  # the whole, 0..556, 444..1000
    empty = FoundBoxes(np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0))
    parts = (*parts, *[empty] * (len(regions) - len(parts)))
    boxes: list[list[float]] = join_regions(parts, regions, [1.0] * 3, _SIZE).boxes_px.tolist()
    return boxes


def test_boxes_are_placed_in_the_image() -> None:
    assert _joined(_found(), _found([1, 2, 30, 40]), _found([100, 2, 130, 40])) == [
        [1, 2, 30, 40],
        [544, 2, 574, 40],
    ]


def test_a_cut_box_goes_where_another_tile_shows_the_object() -> None:
    # The left tile ends at x = 556 and sees a car from 500 on; the right one sees it whole.
    whole_car = [500.0, 100, 620, 160]
    assert _joined(_found(), _found([500, 101, 555, 159]), _found([56, 100, 176, 160])) == [
        whole_car
    ]
    # Where both show as much of it, suppression takes one of the two.
    assert len(_joined(_found(), _found([446, 100, 554, 200]), _found([2, 100, 110, 200]))) == 2
    # Half of it may be taken for something else, and end a little before the border.
    part = _found([505, 101, 550, 159], class_id=7)
    assert _joined(_found(), part, _found([56, 100, 176, 160])) == [whole_car]
    # A lorry that both tiles cut is whole in the image.
    lorry = [300.0, 100, 800, 300]
    assert _joined(_found(lorry), _found([300, 100, 556, 300]), _found([0, 100, 356, 300])) == [
        lorry
    ]


def test_a_cut_box_stays_where_nothing_shows_more() -> None:
    part = [500.0, 101, 555, 159]
    assert _joined(_found(), _found(part)) == [part]
    # A smaller part of it shows no more of it, nor does what lies beside it.
    assert _joined(_found(), _found(part), _found([130, 100, 250, 160]))[0] == part
    assert _joined(_found(), _found(part), _found([56, 101, 80, 159]))[0] == part


def test_what_no_border_cuts_stays_in_front_of_something_larger() -> None:
    child = [200.0, 120, 230, 160]
    assert _joined(_found([150, 90, 300, 170]), _found(child))[1] == child
    # Nor is a box a part of another one from its own tile.
    bus, child = [300.0, 100, 555, 300], [500.0, 200, 552, 290]
    assert _joined(_found(), _found(bus, child)) == [bus, child]


def test_the_border_of_the_image_cuts_nothing() -> None:
    at_border = [0.0, 100, 40, 160]
    assert _joined(_found([0, 90, 60, 170]), _found(at_border)) == [
        [0, 90, 60, 170],
        at_border,
    ]
