"""Boxes and lights of the map: the shift that all share, pairs, and misses."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.lights.association import AssociationConfig, match_lights
from percept.lights.projection import ProjectedLights

SIZE = (12.0, 32.0)


def box(u: float, v: float, size: tuple[float, float] = SIZE) -> list[float]:
    return [u - size[0] / 2, v - size[1] / 2, u + size[0] / 2, v + size[1] / 2]


def projected(
    *boxes: list[float],
    bulbs: tuple[str, ...] = ("red", "yellow", "green"),
    image_size: tuple[int, int] = (640, 400),
) -> ProjectedLights:
    count = len(boxes)
    return ProjectedLights(
        ids=np.arange(count) + 100,
        boxes_px=np.array(boxes, dtype=np.float64).reshape(-1, 4),
        inside=np.ones(count),
        range_m=np.full(count, 40.0),
        angle_rad=np.zeros(count),
        bulbs=(bulbs,) * count,
        shared_sd_px=6.0,
        own_sd_px=np.full(count, 3.0),
        image_size=image_size,
    )


def shifted(boxes: NDArray[np.float64], u: float, v: float) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = boxes + np.array([u, v, u, v])
    return moved


ROW = projected(box(200, 100), box(240, 100), box(300, 90))


def test_the_shift_that_all_share_is_found_exactly() -> None:
    found = match_lights(ROW, shifted(ROW.boxes_px[[2, 0, 1]], -11.0, 7.0))
    np.testing.assert_allclose(found.offset_px, [-11, 7], atol=1e-9)
    assert found.pairs.tolist() == [[0, 1], [1, 2], [2, 0]]
    np.testing.assert_allclose(found.costs, 0, atol=1e-9)
    assert found.missed.tolist() == found.spare.tolist() == []


@pytest.mark.parametrize("kept", [[0], [1], [2], [0, 1], [0, 2], [1, 2]])
def test_of_lights_side_by_side_the_right_ones_are_missed(kept: list[int]) -> None:
    found = match_lights(ROW, shifted(ROW.boxes_px[kept], 6.0, -10.0))
    assert found.pairs.tolist() == [[light, row] for row, light in enumerate(kept)]
    assert found.missed.tolist() == sorted({0, 1, 2} - set(kept))


def test_a_false_box_does_not_pull_the_shift() -> None:
    boxes = np.vstack([box(246, 118), shifted(ROW.boxes_px, 1.0, 1.0), box(420, 300)])
    found = match_lights(ROW, boxes)
    np.testing.assert_allclose(found.offset_px, [1, 1], atol=1e-9)
    assert found.pairs.tolist() == [[0, 1], [1, 2], [2, 3]]
    assert found.spare.tolist() == [0, 4]


def test_lights_shift_a_little_each_on_its_own() -> None:
    own = np.array([[2.0, 0.0], [-2.0, 1.0], [0.0, -1.0]])
    boxes = shifted(ROW.boxes_px, 5.0, 5.0) + np.tile(own, 2)
    found = match_lights(ROW, boxes)
    assert found.pairs.tolist() == [[0, 0], [1, 1], [2, 2]]
    np.testing.assert_allclose(found.offset_px, [5, 5])  # the median of each axis
    assert (found.costs > 0).sum() >= 2


def test_a_box_that_is_too_far_away_is_no_light() -> None:
    one = projected(box(200, 100))
    found = match_lights(one, np.array([box(240, 100)]))
    assert found.pairs.tolist() == []
    assert (found.missed.tolist(), found.spare.tolist()) == ([0], [0])
    assert found.offset_px.tolist() == [0, 0]


def test_a_box_of_another_size_is_no_light() -> None:
    one = projected(box(200, 100))
    assert len(match_lights(one, np.array([box(200, 100, (60.0, 60.0))])).pairs) == 0
    assert len(match_lights(one, np.array([box(200, 100, (10.0, 26.0))])).pairs) == 1


def test_a_colour_that_the_light_has_no_lamp_of_costs() -> None:
    one = projected(box(200, 100), bulbs=("red", "green"))
    boxes = np.array([box(200, 100), box(204, 100)])
    assert match_lights(one, boxes, ["yellow", "off"]).pairs.tolist() == [[0, 1]]
    assert match_lights(one, boxes, ["red", "off"]).pairs.tolist() == [[0, 0]]
    assert match_lights(projected(box(200, 100), bulbs=()), boxes[:1], ["yellow"]).costs[0] < 1e-9


def test_a_light_that_the_border_cuts_is_compared_with_what_is_left_of_it() -> None:
    cut = projected([-6.0, 84.0, 6.0, 116.0], box(60, 100))
    boxes = np.clip(shifted(cut.boxes_px, 2.0, 3.0), 0, None)
    found = match_lights(cut, boxes)
    np.testing.assert_allclose(found.offset_px, [2, 3], atol=0.6)
    assert found.pairs.tolist() == [[0, 0], [1, 1]]
    assert found.costs.max() < 0.5


def test_a_miss_costs_what_is_said() -> None:
    near = projected(box(200, 100), box(200, 180))
    boxes = np.array([box(200, 100), box(214, 180)])
    assert len(match_lights(near, boxes).pairs) == 2
    strict = AssociationConfig(miss_cost=2.0)
    assert len(match_lights(near, boxes, config=strict).pairs) == 1


@pytest.mark.parametrize(("lights", "boxes"), [(0, 0), (0, 2), (2, 0)])
def test_nothing_on_a_side(lights: int, boxes: int) -> None:
    found = match_lights(
        projected(*[box(100 * k, 50) for k in range(1, lights + 1)]),
        np.array([box(100 * k, 50) for k in range(1, boxes + 1)]).reshape(-1, 4),
    )
    assert found.pairs.shape == (0, 2)
    assert found.missed.tolist() == list(range(lights))
    assert found.spare.tolist() == list(range(boxes))


def test_the_order_of_boxes_does_not_matter() -> None:
    rng = np.random.default_rng(2)
    boxes = shifted(ROW.boxes_px, 4.0, -6.0) + rng.normal(0, 1, (3, 4))
    first = match_lights(ROW, boxes)
    turned = match_lights(ROW, boxes[::-1])
    assert [(a, 2 - b) for a, b in turned.pairs.tolist()] == [(a, b) for a, b in first.pairs]
    np.testing.assert_allclose(turned.offset_px, first.offset_px)


def test_columns_must_fit() -> None:
    with pytest.raises(GeometryError, match="2 colours need"):
        match_lights(ROW, ROW.boxes_px, ["red", "red"])
    with pytest.raises(GeometryError, match="colours need"):
        match_lights(ROW, np.zeros((3, 5)))
