"""Where the ground is looked for first, and where it is no longer known; what hides it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.lane_markings import Sight
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.lanes import flat_ground, ground_from_points, observe_paint

_F64 = NDArray[np.float64]
_CAMERA = Drive(DriveConfig(seed=5, seconds=1)).cameras[0]


def _road(level_m: float, grade: float = 0.0, first_m: float = -5.0, last_m: float = 30.0) -> _F64:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(first_m, last_m, 9000), rng.uniform(-6, 6, 9000)
    return np.column_stack([x, y, level_m + grade * x + rng.normal(0, 0.01, len(x))])


@pytest.mark.parametrize("level_m", [-1.8, -0.35, 0.0, 0.6])
@pytest.mark.parametrize("grade", [-0.05, 0.05])
def test_the_road_is_found_at_any_height_of_the_frame(level_m: float, grade: float) -> None:
    ground = ground_from_points(_road(level_m, grade))
    assert ground.source == "points"
    at = np.arange(-4.0, 29.0)
    np.testing.assert_allclose(ground.profile(at), level_m + grade * at, atol=0.03)


def test_a_lorry_beside_of_which_more_is_seen_is_not_the_road() -> None:
    road = _road(-0.35)
    rng = np.random.default_rng(4)
    count = 1200
    roof = np.column_stack(
        [rng.uniform(4, 10, count), rng.uniform(1, 3, count), rng.normal(0.9, 0.01, count)]
    )
    seen = np.vstack([road[::3], roof])
    near = (seen[:, 0] > 4) & (seen[:, 0] < 10)
    assert (seen[near, 2] > 0.5).sum() > 2 * (seen[near, 2] < 0).sum()
    ground = ground_from_points(seen)
    np.testing.assert_allclose(ground.profile(np.array([5.0, 9.0])), -0.35, atol=0.03)


def test_points_below_the_road_are_not_the_road() -> None:
    road = _road(-0.35)
    below = road[:40] - [0.0, 0.0, 1.2]
    ground = ground_from_points(np.vstack([road, below]))
    np.testing.assert_allclose(ground.profile(np.array([5.0, 15.0])), -0.35, atol=0.03)


def test_what_comes_after_a_long_gap_is_no_ground() -> None:
    """Behind a gap it is a guess which level is the road: the last grade goes on, less sure."""
    near, roofs = _road(-0.35, last_m=12.0), _road(0.4, first_m=24.0)
    ground = ground_from_points(np.vstack([near, roofs]))
    assert ground.x_m[-1] < 13
    assert ground.profile(np.array([26.0]))[0] == pytest.approx(-0.35, abs=0.2)
    assert ground.spread(np.array([26.0]))[0] > 3 * ground.spread(np.array([8.0]))[0]


def test_with_no_road_ahead_it_is_flat_at_the_level_about_the_vehicle() -> None:
    ground = ground_from_points(_road(-0.35, last_m=3.0))
    assert ground.source == "flat"
    assert "taken as flat" in ground.notes[0]
    np.testing.assert_allclose(ground.z_m, -0.35, atol=0.03)


def test_knots_side_by_side_make_no_grade() -> None:
    """The points of two pieces may lie together at the edge between them."""
    road = _road(0.0)
    middle = (road[:, 0] < 11.7) | (road[:, 0] > 12.3)
    ahead = (road[:, 0] > 9) & (road[:, 0] < 16)
    ring = road[~(ahead & middle)]
    ring[(ring[:, 0] > 12.0) & (ring[:, 0] < 12.3), 2] += 0.08
    ground = ground_from_points(ring)
    assert np.diff(ground.x_m).min() >= 1.0
    assert np.abs(ground.grade(ground.x_m)).max() < 0.06


@pytest.mark.parametrize(
    ("sides_m", "hides"),
    [((18.0, 2.6), True), ((4.5, 1.9), True), ((40.0, 0.5), True), ((30.0, 8.0), False)],
    ids=["a long bus", "a car", "a straight wall", "an outline about many things"],
)
def test_what_hides_the_road(sides_m: tuple[float, float], *, hides: bool) -> None:
    length, width = sides_m
    box = [[9.0 + width / 2, 0.0, 1.6, length, width, 3.2, np.pi / 2]]
    height = _CAMERA.image_size[1]
    image = np.full((height, _CAMERA.image_size[0], 3), 90, np.uint8)
    seen = observe_paint(image, _CAMERA, stamp_ns=1, ground=flat_ground(), occluders=box)
    behind = seen.coverage.at(np.array([[9.0 + width + 2.0, 0.0]]))[0]
    assert bool(behind == Sight.OCCLUDED) is hides
