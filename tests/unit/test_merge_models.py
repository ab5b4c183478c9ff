"""Several models on one image: the most confident box of an object counts."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.results import Detections2D
from percept.detection.boxes.merge_models import primary_boxes


def _found(*rows: tuple[str, float, tuple[float, float, float, float]]) -> Detections2D:
    return Detections2D(
        0,
        "front",
        np.array([row[2] for row in rows], np.float64).reshape(-1, 4),
        tuple(row[0] for row in rows),
        np.array([row[1] for row in rows], np.float64),
    )


_BOX = (10.0, 10.0, 50.0, 30.0)
_NEAR = (12.0, 10.0, 52.0, 30.0)  # IoU 38 / 42
_FAR = (40.0, 10.0, 80.0, 30.0)  # IoU 10 / 70


def test_the_most_confident_of_two_models_counts_whatever_the_case_of_the_class() -> None:
    small, large = _found(("car", 0.6, _BOX)), _found(("Car", 0.8, _NEAR))
    primary = primary_boxes({"small": small, "large": large})
    assert primary["small"].tolist() == [False]
    assert primary["large"].tolist() == [True]


def test_other_classes_places_and_boxes_of_one_model_do_not_compete() -> None:
    small = _found(("car", 0.6, _BOX), ("car", 0.5, _NEAR))
    large = _found(("truck", 0.9, _BOX), ("car", 0.9, _FAR))
    primary = primary_boxes({"small": small, "large": large})
    assert all(mask.all() for mask in primary.values())


def test_of_equals_the_first_model_counts() -> None:
    found = _found(("car", 0.7, _BOX))
    primary = primary_boxes({"a": found, "b": found, "c": found})
    assert [bool(primary[name][0]) for name in "abc"] == [True, False, False]


def test_a_box_that_does_not_count_takes_no_other_out() -> None:
    """A chain: the middle one loses to the best, so that the third stays."""
    step = 14.0  # IoU of neighbours 26 / 54 = 0.48, of the outer two 12 / 68
    chain = [(k * step, 0.0, k * step + 40, 20.0) for k in range(3)]
    boxes = {name: _found(("car", 0.9 - 0.1 * k, chain[k])) for k, name in enumerate("abc")}
    primary = primary_boxes(boxes)
    assert [bool(primary[name][0]) for name in "abc"] == [True, False, True]


@pytest.mark.parametrize("iou", [0.9, 0.91])
def test_the_overlap_that_makes_one_object_can_be_set(iou: float) -> None:
    boxes = {"a": _found(("car", 0.9, _BOX)), "b": _found(("car", 0.8, _NEAR))}
    assert primary_boxes(boxes, iou)["b"].tolist() == [iou > 38 / 42]


def test_models_without_boxes_have_empty_masks() -> None:
    assert primary_boxes({}) == {}
    empty = primary_boxes({"a": _found(), "b": _found(("car", 0.5, _BOX))})
    assert (empty["a"].shape, empty["b"].tolist()) == ((0,), [True])
    assert primary_boxes({"a": _found()})["a"].dtype == np.bool_
