"""Overlap of boxes against areas found in other ways: half planes, hulls, samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from percept.core.box_overlap import giou_3d, iou_3d, iou_bev
from percept.core.errors import GeometryError

_F64 = NDArray[np.float64]
_UNIT = np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0]])

_places = st.floats(-4.0, 4.0)
_sizes = st.floats(0.2, 6.0)
_boxes = st.builds(
    lambda *values: np.array(values), *[_places] * 3, *[_sizes] * 3, st.floats(-7.0, 7.0)
)


def _axes(box: _F64) -> _F64:
    cosine, sine = math.cos(box[6]), math.sin(box[6])
    return np.array([[cosine, sine], [-sine, cosine]])


def _half_planes(box: _F64) -> _F64:
    axes, half = _axes(box), box[3:5] / 2
    offsets = np.concatenate([axes @ box[:2] + half, half - axes @ box[:2]])
    return np.column_stack([np.vstack([axes, -axes]), -offsets])


def _corners(box: _F64) -> _F64:
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    return (signs * box[3:5]) @ _axes(box) + box[:2]


def _shared_area(a: _F64, b: _F64) -> float:
    planes = np.vstack([_half_planes(a), _half_planes(b)])
    # The middle of the largest circle inside all half planes, which the intersection starts from.
    inner = linprog(
        [0, 0, -1],
        A_ub=np.column_stack([planes[:, :2], np.ones(len(planes))]),
        b_ub=-planes[:, 2],
        bounds=[(None, None), (None, None), (0, None)],
    )
    if inner.status != 0 or inner.x[2] < 1e-6:
        return 0.0
    return float(ConvexHull(HalfspaceIntersection(planes, inner.x[:2]).intersections).volume)


def _span(a: _F64, b: _F64) -> tuple[float, float]:
    """Return the height that both share, and that from the lowest to the highest."""
    tops, bottoms = [box[2] + box[5] / 2 for box in (a, b)], [box[2] - box[5] / 2 for box in (a, b)]
    return max(min(tops) - max(bottoms), 0.0), max(tops) - min(bottoms)


@settings(max_examples=150)
@given(a=_boxes, b=_boxes)
def test_agrees_with_half_planes_and_hulls(a: _F64, b: _F64) -> None:
    area, (shared_m, span_m) = _shared_area(a, b), _span(a, b)
    union_area = a[3] * a[4] + b[3] * b[4] - area
    volume = area * shared_m
    union = a[3:6].prod() + b[3:6].prod() - volume
    hull = float(ConvexHull(np.vstack([_corners(a), _corners(b)])).volume) * span_m
    pair = a[None], b[None]
    assert iou_bev(*pair)[0, 0] == pytest.approx(area / union_area, abs=1e-5)
    assert iou_3d(*pair)[0, 0] == pytest.approx(volume / union, abs=1e-5)
    assert giou_3d(*pair)[0, 0] == pytest.approx(volume / union - (hull - union) / hull, abs=1e-5)


@settings(max_examples=50)
@given(a=_boxes, b=_boxes)
def test_agrees_with_samples(a: _F64, b: _F64) -> None:
    """The share of a fine grid over the first box that lies in the second one too."""
    steps = (np.arange(60) + 0.5) / 60 - 0.5
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) * a[3:5]
    local = (grid @ _axes(a) + a[:2] - b[:2]) @ _axes(b).T
    area = float((np.abs(local) <= b[3:5] / 2).all(axis=1).mean()) * a[3] * a[4]
    assert iou_bev(a[None], b[None])[0, 0] == pytest.approx(
        area / (a[3] * a[4] + b[3] * b[4] - area), abs=0.03
    )


@settings(max_examples=100)
@given(a=_boxes, b=_boxes, shift=st.floats(-1e5, 1e5), turn=st.floats(-3.0, 3.0))
def test_order_place_and_direction_make_no_difference(
    a: _F64, b: _F64, shift: float, turn: float
) -> None:
    moved = []
    for box in (a, b):
        other = box.copy()
        cosine, sine = math.cos(turn), math.sin(turn)
        other[:2] = np.array([[cosine, -sine], [sine, cosine]]) @ box[:2] + shift
        other[6] += turn + math.pi
        moved.append(other[None])
    for overlap in (iou_bev, iou_3d, giou_3d):
        value = overlap(a[None], b[None])[0, 0]
        assert overlap(b[None], a[None])[0, 0] == pytest.approx(value, abs=1e-9)
        assert overlap(*moved)[0, 0] == pytest.approx(value, abs=1e-6)
        assert overlap(a[None], a[None])[0, 0] == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=50)
@given(a=_boxes, b=_boxes)
def test_far_pairs_are_cut_off(a: _F64, b: _F64) -> None:
    distance = math.hypot(a[0] - b[0], a[1] - b[1])
    assume(distance > 1e-3)
    pair = a[None], b[None]
    assert giou_3d(*pair, within_m=distance * 0.99)[0, 0] == -1.0
    assert giou_3d(*pair, within_m=distance * 1.01) == giou_3d(*pair)


def test_hand_worked_boxes() -> None:
    half = _UNIT + np.array([0.5, 0, 0, 0, 0, 0, 0])
    assert iou_bev(_UNIT, half) == pytest.approx(np.array([[1 / 3]]))
    beside = _UNIT + np.array([1.5, 0, 0, 0, 0, 0, 0])
    assert iou_3d(_UNIT, beside) == 0.0
    assert giou_3d(_UNIT, beside) == pytest.approx(np.array([[-(2.5 - 2.0) / 2.5]]))
    eighth = _UNIT + np.array([0, 0, 0, 0, 0, 0, math.pi / 4])  # a regular octagon is shared
    octagon = 2 * (math.sqrt(2) - 1)
    assert iou_bev(_UNIT, eighth) == pytest.approx(np.array([[octagon / (2 - octagon)]]))


def test_shapes_and_unusable_boxes() -> None:
    assert iou_3d(np.zeros((0, 7)), np.tile(_UNIT, (3, 1))).shape == (0, 3)
    flat = _UNIT * np.array([1, 1, 1, 0, 1, 1, 1])
    assert [f(flat, flat).item() for f in (iou_3d, iou_bev, giou_3d)] == [0.0, 0.0, -1.0]
    with pytest.raises(GeometryError, match="boxes are"):
        iou_bev(_UNIT[:, :6], _UNIT)
    with pytest.raises(GeometryError, match="finite"):
        giou_3d(_UNIT * np.nan, _UNIT)
    with pytest.raises(GeometryError, match="negative"):
        iou_3d(_UNIT, -_UNIT)
