"""Sweeps of a LiDAR put together to a view of the road."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.transform import Transform, rotation_from_rpy
from percept.lanes.ground import GroundSurface, flat_ground
from percept.lanes.sweeps import RoadSweep, SweepWindow, road_sweep

_F64 = NDArray[np.float64]
_LINE = np.column_stack([np.arange(-20.0, 60.0, 0.25), np.full(320, 1.5), np.zeros(320)])


def _at(x: float, yaw: float = 0.0, pitch: float = 0.0, z: float = 0.0) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(0.0, pitch, yaw)
    matrix[:3, 3] = x, 0.0, z
    return Transform("map", "base_link", matrix)


def _sweep(
    T_map_base: Transform,
    points: _F64 = _LINE,
    *,
    boxes: _F64 | None = None,
    ground: GroundSurface | None = None,
) -> RoadSweep:
    return road_sweep(
        T_map_base.inverse().apply(points),
        np.arange(len(points), dtype=np.float32),
        ground=flat_ground() if ground is None else ground,
        boxes_m=np.zeros((0, 7)) if boxes is None else boxes,
        T_map_base=T_map_base,
    )


def test_only_what_lies_on_the_road_is_kept() -> None:
    points = np.array(
        [[5, 0, 0.05], [5, 0, 0.4], [5, 0, -0.4], [40, 0, 0], [5, 13, 0], [6, 1, 0.0]]
    )
    np.testing.assert_array_equal(_sweep(_at(0), points).points[:, 3], [0, 5])


def test_what_is_not_finite_is_left_out() -> None:
    points = np.array([[5, 0, 0], [np.nan, 0, 0], [5, 1, 0.0]])
    intensity = np.array([1, 2, np.inf])
    swept = road_sweep(
        points, intensity, ground=flat_ground(), boxes_m=np.zeros((0, 7)), T_map_base=_at(0)
    )
    np.testing.assert_array_equal(swept.points[:, 3], [1])


def test_what_lies_in_the_outline_of_a_thing_is_no_road() -> None:
    points = np.array([[10, 0, 0], [10, 2, 0], [12.2, 2, 0], [8, 2, 0.0]])
    box = np.array([[10, 0, 0.8, 6, 1.8, 1.6, np.pi / 4]])
    np.testing.assert_array_equal(_sweep(_at(0), points, boxes=box).points[:, 3], [1, 3])


def test_points_without_an_intensity_each_are_refused() -> None:
    with pytest.raises(GeometryError, match="intensity each"):
        road_sweep(
            np.zeros((3, 3)),
            np.zeros(2),
            ground=flat_ground(),
            boxes_m=np.zeros((0, 7)),
            T_map_base=_at(0),
        )


def test_sweeps_come_together_where_they_were_seen() -> None:
    window = SweepWindow(length_m=10, spacing_m=4)
    views = [window.push(_sweep(_at(x, yaw=0.02 * x))) for x in (0.0, 2.0, 4.0)]
    assert views[0] is views[1] is None
    assert views[2] is not None
    points = views[2].points_base
    in_map = _at(4.0, yaw=0.08).apply(points[:, :3])
    np.testing.assert_allclose(in_map[:, 1], 1.5, atol=1e-5)
    np.testing.assert_allclose(in_map[:, 0], -20 + 0.25 * points[:, 3], atol=1e-5)
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-6)
    assert len(points) > 2.5 * len(_sweep(_at(4.0)).points)


def test_heights_are_above_the_road_of_each_moment() -> None:
    """Poses that rise and pitch do not lift the road, nor do they hide it."""
    window = SweepWindow(length_m=10, spacing_m=2)
    higher, nose_down = _at(0.0, z=0.5), _at(2.0, pitch=0.02)
    below = flat_ground(-0.5)
    window.push(_sweep(higher, ground=below))
    view = window.push(_sweep(nose_down, ground=flat_ground().with_pitch(0.02)))
    assert view is not None
    assert len(view.points_base) > 300
    off = view.points_base[:, 2] - view.ground.height(view.points_base)
    np.testing.assert_allclose(off, 0.0, atol=0.01)


def test_views_come_about_every_so_many_metres_and_old_sweeps_go() -> None:
    window = SweepWindow(length_m=3, spacing_m=2)
    found = [window.push(_sweep(_at(x))) for x in np.arange(0, 20.5, 0.5)]
    views = [view for view in found if view is not None]
    assert len(views) == 10
    counts = [len(view.points_base) for view in views]
    per_sweep = len(_sweep(_at(5.0)).points)
    assert max(counts) <= 7 * per_sweep


def test_a_vehicle_that_stands_adds_nothing() -> None:
    window = SweepWindow(spacing_m=2)
    assert window.push(_sweep(_at(0.0))) is None
    for step in range(50):
        assert window.push(_sweep(_at(0.001 * step))) is None
    view = window.push(_sweep(_at(2.0)))
    assert view is not None
    assert len(view.points_base) < 2.5 * len(_sweep(_at(0.0)).points)
