"""Laws of the ground, of the view of it from above, and of coverage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.lane_markings import GroundCoverage, Sight
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.lanes import GroundSurface, ground_from_points
from percept.lanes.birdseye import BirdsEye

_F64 = NDArray[np.float64]

_CAMERA = Drive(DriveConfig(seed=5, seconds=1)).cameras[0]


@given(
    x=st.floats(5.5, 18), y=st.floats(-4, 4), slope=st.floats(-0.03, 0.03),
    grades=st.lists(st.floats(-0.05, 0.05), min_size=4, max_size=4),
)  # fmt: skip
def test_pixels_and_points_of_the_ground_belong_to_each_other(
    x: float, y: float, slope: float, grades: list[float]
) -> None:
    knots = np.array([0.0, 6.0, 12.0, 18.0, 24.0])
    heights = np.concatenate([[0.0], np.cumsum(np.array(grades) * 6.0)])
    ground = GroundSurface(x_m=knots, z_m=heights, sd_m=np.full(5, 0.01), cross_slope=slope)
    view = BirdsEye(_CAMERA, ground)
    point = np.array([[x, y]])
    pixel, seen = view.pixels(point)
    assume(bool(seen[0]) and _is_met_first(view, point))
    np.testing.assert_allclose(view.points(pixel), point, atol=1e-3)
    there = view.grid.cells(point)
    np.testing.assert_allclose(view.grid.points(there), point, atol=1e-9)


def _is_met_first(view: BirdsEye, point: _F64) -> bool:
    """Return whether no road lies between the camera and a point of it."""
    target = np.append(point[0], view.ground.height(point))
    way = view.eye_m + np.linspace(0.05, 0.99, 200)[:, None] * (target - view.eye_m)
    return bool((way[:, 2] > view.ground.height(way) + 1e-3).all())


@given(seed=st.integers(0, 10_000))
def test_coverage_at_a_point_is_that_of_its_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sights = rng.integers(0, 5, (7, 9), dtype=np.uint8)
    coverage = GroundCoverage((2.0, -1.0), 0.25, sights)
    row, column = rng.integers(0, 7, 30), rng.integers(0, 9, 30)
    inside = rng.uniform(0.01, 0.99, (30, 2))
    points = np.array([2.0, -1.0]) + (np.column_stack([row, column]) + inside) * 0.25
    assert (coverage.at(points) == sights[row, column]).all()
    beyond = points + np.array([100.0, 0.0])
    assert (coverage.at(beyond) == Sight.OUT_OF_VIEW).all()


@given(
    pitch=st.floats(-0.03, 0.03), kink=st.floats(-0.05, 0.05), cross=st.floats(-0.03, 0.03),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_the_ground_is_found_below_what_stands_on_it(
    pitch: float, kink: float, cross: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-5, 30, 15_000), rng.uniform(-6, 6, 15_000)
    height = pitch * x + kink * np.maximum(x - 12.0, 0.0)
    z = height + cross * y + rng.normal(0, 0.01, len(x))
    # Two cars whose sides and roofs are seen, and a row of posts, in place of the ground below.
    for x0, y0 in ((8.0, -2.0), (18.0, 2.0)):
        car = (np.abs(x - x0) < 2.2) & (np.abs(y - y0) < 1.0)
        z[car] += rng.uniform(0.3, 1.5, car.sum())
    ground = ground_from_points(np.column_stack([x, y, z]))
    assert ground.source == "points"
    assert not ground.notes
    at = np.arange(3.0, 28.0, 0.5)
    truth = pitch * at + kink * np.maximum(at - 12.0, 0.0)
    assert np.abs(ground.profile(at) - truth).max() < 0.06
    assert abs(ground.cross_slope - cross) < 0.01


@pytest.mark.parametrize("origin_m", [0.0, 0.35, 1.8])
def test_the_origin_of_the_vehicle_may_lie_above_the_road(origin_m: float) -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-5, 30, 15_000), rng.uniform(-6, 6, 15_000)
    z = 0.02 * x - origin_m + rng.normal(0, 0.01, len(x))
    car = (np.abs(x - 9.0) < 2.2) & (np.abs(y) < 1.0)
    z[car] += rng.uniform(0.3, 1.5, car.sum())
    ground = ground_from_points(np.column_stack([x, y, z]))
    at = np.arange(0.0, 28.0, 0.5)
    np.testing.assert_allclose(ground.profile(at), 0.02 * at - origin_m, atol=0.05)


def test_too_few_points_leave_the_ground_flat_and_say_so() -> None:
    for points in (np.zeros((0, 3)), np.random.default_rng(0).uniform(-1, 1, (30, 3))):
        ground = ground_from_points(points)
        assert ground.source == "flat"
        assert "Too few points" in ground.notes[0]
        assert not ground.z_m.any()
