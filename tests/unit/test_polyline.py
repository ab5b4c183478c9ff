"""Ways along lines, and places on them."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.polyline import along_m, beside, length_m, nearest_place, points_along, points_at

# 3 m along x, a point that stands twice, 4 m up y and 5 m up z.
LINE = np.array([[0.0, 0.0, 1.0], [3.0, 0.0, 1.0], [3.0, 0.0, 1.0], [3.0, 4.0, 6.0]])


def test_the_way_along_a_line_is_seen_from_above_and_its_length_is_not() -> None:
    assert along_m(LINE).tolist() == [0.0, 3.0, 3.0, 7.0]
    assert length_m(LINE[:, :2]) == 7.0
    assert length_m(LINE) == pytest.approx(3.0 + np.hypot(4.0, 5.0))


def test_places_beyond_an_end_are_that_end() -> None:
    places = points_at(LINE, np.array([-1.0, 1.5, 3.0, 5.0, 9.0]))
    expected = np.array([[0, 0, 1], [1.5, 0, 1], [3, 0, 1], [3, 2, 3.5], [3, 4, 6]])
    np.testing.assert_allclose(places, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("point", "place"),
    [((1.0, -2.0), (1, 0, 1)), ((5.0, 2.0), (3, 2, 3.5)), ((9.0, 9.0), (3, 4, 6))],
)
def test_the_nearest_place_lies_on_the_line(
    point: tuple[float, float], place: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(nearest_place(LINE, np.array(point)), place, atol=1e-12)


def test_a_line_of_one_point_is_near_everything() -> None:
    assert nearest_place(LINE[:1], np.array([7.0, 7.0])).tolist() == [0.0, 0.0, 1.0]


def test_points_along_lines_are_at_most_a_step_apart() -> None:
    points = points_along([LINE[:2], LINE[2:]], 1.6)
    assert points[:2].tolist() == [[0.0, 0.0], [1.5, 0.0]]
    assert len(points) == 2 + 3 + 2
    assert len(points_along([], 1.0)) == 0


def test_a_line_moved_to_its_left_keeps_its_heights() -> None:
    moved = beside(np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 2.0], [4.0, 0.0, 5.0]]), 0.5)
    assert moved.tolist() == [[0.0, 0.5, 1.0], [2.0, 0.5, 2.0], [4.0, 0.5, 5.0]]
