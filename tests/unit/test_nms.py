"""Suppression of duplicates against plain loops and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.detection.boxes.nms import suppress_duplicates

_Columns = tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]


def _random(seed: int, count: int, classes: int, span: float) -> _Columns:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-10, span, (count, 2))
    boxes = np.hstack([low, low + rng.uniform(1, 60, (count, 2))])
    return boxes, rng.integers(0, classes, count), rng.uniform(0, 1, count).round(2)


def _iou(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    width, height = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    if width <= 0 or height <= 0:
        return 0.0
    areas = [float(np.prod(box[2:] - box[:2])) for box in (a, b)]
    return float(width * height / (sum(areas) - width * height))


def _plain(boxes: NDArray[np.float64], ids: NDArray[np.int64], scores: NDArray[np.float64],
           iou: float) -> list[int]:  # fmt: skip
    kept: list[int] = []
    for i in sorted(range(len(boxes)), key=lambda n: (-scores[n], n)):
        if all(ids[i] != ids[k] or _iou(boxes[k], boxes[i]) <= iou for k in kept):
            kept.append(i)
    return kept


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(0, 60), st.integers(1, 4), st.floats(0, 1))
def test_equals_plain_loops(seed: int, count: int, classes: int, iou: float) -> None:
    columns = _random(seed, count, classes, span=60)
    assert suppress_duplicates(*columns, iou).tolist() == _plain(*columns, iou)


def test_equals_opencv() -> None:
    for seed in range(20):
        boxes, ids, scores = _random(seed, 200, 5, span=200)
        scores = np.random.default_rng(seed).permutation(np.linspace(0.1, 0.9, 200))
        sizes = np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
        theirs = cv2.dnn.NMSBoxesBatched(sizes.tolist(), scores.tolist(), ids.tolist(), 0.0, 0.45)
        ours = suppress_duplicates(boxes, ids, scores, 0.45)
        assert 20 < len(ours) < 200
        assert sorted(ours) == sorted(np.ravel(theirs))


def test_no_pixel_is_added_to_sizes() -> None:
    # 2 x 2 boxes that share a half: 2 of 6 is 0.33; with one pixel more on each side 6 of 12.
    boxes = np.array([[0.0, 0, 2, 2], [1, 0, 3, 2]])
    columns = (boxes, np.zeros(2, np.int64), np.array([0.9, 0.8]))
    assert suppress_duplicates(*columns, 0.34).tolist() == [0, 1]
    assert suppress_duplicates(*columns, 0.33).tolist() == [0]
    assert suppress_duplicates(*columns, 1 / 3).tolist() == [0, 1]  # at the limit both stay


def test_order_among_equals_is_theirs() -> None:
    boxes = np.tile([0.0, 0, 10, 10], (4, 1)) + np.array([[0.0], [50], [0], [100]])
    ids = np.array([1, 1, 1, 0])
    assert suppress_duplicates(boxes, ids, np.full(4, 0.5), 0.45).tolist() == [0, 1, 3]


def test_many_and_none() -> None:
    boxes, ids, scores = _random(0, 10_000, 80, span=600)
    kept = suppress_duplicates(boxes, ids, scores, 0.45)
    assert len(kept) > 9_000
    assert (np.diff(scores[kept]) <= 0).all()
    assert suppress_duplicates(boxes[:0], ids[:0], scores[:0], 0.45).tolist() == []
    flat = np.zeros((3, 4))  # boxes without an area overlap with nothing
    assert len(suppress_duplicates(flat, np.zeros(3, np.int64), np.ones(3), 0.45)) == 3
