"""Oriented boxes: truth comes back, thin clusters stay finite, and partial views stay partial."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import ConfigError, GeometryError
from percept.core.settings import parse_settings
from percept.lidar.boxes import BoxConfig, fit_boxes

_METHODS = ("l_shape", "min_area")


def _placed(
    local_xy: NDArray[np.float64], yaw: float, centre: tuple[float, float], top: float = 1.5
) -> NDArray[np.float32]:
    c, s = np.cos(yaw), np.sin(yaw)
    xy = local_xy @ np.array([[c, s], [-s, c]]) + centre
    z = np.linspace(0.0, top, len(xy))
    return np.column_stack([xy, z]).astype(np.float32)


def _outline(length: float, width: float, count: int, sides: int = 2) -> NDArray[np.float64]:
    """Points on the first sides of a rectangle about the origin, corner to corner."""
    corners = np.array([[1, -1], [-1, -1], [-1, 1], [1, 1], [1, -1]]) * [length / 2, width / 2]
    steps = np.linspace(0, sides, count)
    low = np.minimum(steps.astype(int), sides - 1)
    share = (steps - low)[:, None]
    return np.asarray((1 - share) * corners[low] + share * corners[low + 1])


def _turn_between(yaw: float, truth: float) -> float:
    return float(abs((yaw - truth + np.pi / 2) % np.pi - np.pi / 2))


@pytest.mark.parametrize("yaw_deg", [-89.0, -60.0, -17.3, 0.0, 12.5, 44.9, 71.0, 90.0])
def test_l_shape_finds_a_car_from_two_sides(yaw_deg: float) -> None:
    points = _placed(_outline(4.5, 1.8, 120), np.deg2rad(yaw_deg), (20.0, -7.0))
    box = fit_boxes(points, np.zeros(120, np.int32)).boxes_m[0]
    assert _turn_between(box[6], np.deg2rad(yaw_deg)) < np.deg2rad(0.4)
    np.testing.assert_allclose(box[:3], [20.0, -7.0, 0.75], atol=0.03)
    np.testing.assert_allclose(box[3:6], [4.5, 1.8, 1.5], atol=0.05)
    assert -np.pi / 2 < box[6] <= np.pi / 2


@pytest.mark.parametrize("yaw_deg", [-75.0, 0.0, 33.0, 90.0])
def test_min_area_finds_a_full_rectangle_exactly(yaw_deg: float) -> None:
    points = _placed(_outline(4.0, 2.0, 401, sides=4), np.deg2rad(yaw_deg), (-30.0, 5.0))
    box = fit_boxes(points, np.zeros(401, np.int32), BoxConfig(method="min_area")).boxes_m[0]
    assert _turn_between(box[6], np.deg2rad(yaw_deg)) < 1e-4
    np.testing.assert_allclose(box[:2], [-30.0, 5.0], atol=1e-4)
    np.testing.assert_allclose(box[3:5], [4.0, 2.0], atol=1e-3)


@pytest.mark.parametrize("method", _METHODS)
def test_boxes_hold_all_points_and_touch_them(method: str) -> None:
    rng = np.random.default_rng(5)
    spread = rng.normal(size=(600, 3)) * [2.0, 1.0, 0.5] + [40, 10, 0]
    points = spread.astype(np.float32)
    ids = rng.integers(-1, 4, 600).astype(np.int32)
    fitted = fit_boxes(points, ids, parse_settings(BoxConfig, {"method": method}, "test"))
    assert fitted.points.tolist() == [int((ids == k).sum()) for k in range(4)]
    for k, box in enumerate(fitted.boxes_m):
        c, s = np.cos(box[6]), np.sin(box[6])
        offset = points[ids == k] - box[:3]
        u, v = offset[:, 0] * c + offset[:, 1] * s, offset[:, 1] * c - offset[:, 0] * s
        half = [np.abs(u).max(), np.abs(v).max(), np.abs(offset[:, 2]).max()]
        np.testing.assert_allclose(half, box[3:6] / 2, atol=1e-5)
        assert box[3] >= box[4]


def test_a_car_seen_from_behind_gets_no_invented_length() -> None:
    across = np.column_stack([np.zeros(40), np.linspace(-0.9, 0.9, 40)])
    box = fit_boxes(_placed(across, 0.0, (15.0, 0.0)), np.zeros(40, np.int32)).boxes_m[0]
    np.testing.assert_allclose(box[3:5], [1.8, 0.05], atol=1e-3)
    assert abs(box[6]) == pytest.approx(np.pi / 2, abs=1e-3)


def test_surface_tells_a_wall_from_a_bush() -> None:
    rng = np.random.default_rng(2)
    bush = rng.uniform([10, -2, 0], [14, 2, 2], (400, 3))
    near, far = bush.copy(), bush.copy()
    near[:, 0], far[:, 0] = 10.0, 14.0
    corners = [[10, -2, 0], [14, 2, 2]]
    points = np.vstack([bush, near, corners, far, corners]).astype(np.float32)
    ids = np.repeat([0, 1, 2], [400, 402, 402]).astype(np.int32)
    bush_share, near_share, far_share = fit_boxes(points, ids).surface
    assert 0.02 < bush_share < 0.2
    assert near_share > 0.99
    assert far_share < 0.2


def test_surface_measures_depth_along_the_side_that_it_lies_behind() -> None:
    # The middle of a car 4.4 m long: 1.4 m behind its rear and 0.9 m behind its side.
    outline = _outline(4.4, 1.8, 401, sides=4)
    inside = np.tile([[-0.8, 0.0]], (99, 1))
    points = _placed(np.vstack([outline, inside]), 0.0, (20.0, 0.0))
    fitted = fit_boxes(points, np.zeros(500, np.int32), BoxConfig(method="min_area"))
    on_near_sides = (outline[:, 0] < -2.0) | (outline[:, 1] < -0.7)
    assert fitted.surface[0] == pytest.approx(on_near_sides.sum() / 500, abs=0.02)


@pytest.mark.parametrize("method", _METHODS)
@pytest.mark.parametrize(
    "local",
    [
        np.zeros((1, 2)),
        np.zeros((50, 2)),
        np.array([[0.0, 0.0], [1.0, 2.0]]),
        np.column_stack([np.linspace(0, 3, 9), np.linspace(0, 1, 9)]),
    ],
    ids=["one point", "one place", "two points", "a line"],
)
def test_degenerate_clusters_stay_finite(method: str, local: NDArray[np.float64]) -> None:
    points = _placed(local, 0.3, (1e3, -1e3), top=0.0)
    config = parse_settings(BoxConfig, {"method": method}, "test")
    box = fit_boxes(points, np.zeros(len(points), np.int32), config).boxes_m[0]
    assert np.isfinite(box).all()
    assert (box[3:6] >= config.min_extent_m).all()
    assert -np.pi < box[6] <= np.pi


def test_the_same_clusters_give_the_same_bits_beside_others() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-50, 50, (2000, 3)).astype(np.float32)
    ids = rng.integers(-1, 30, 2000).astype(np.int32)
    whole = fit_boxes(points, ids)
    assert whole.boxes_m.tobytes() == fit_boxes(points, ids).boxes_m.tobytes()
    alone = ids == 7
    single = fit_boxes(points[alone], np.zeros(alone.sum(), np.int32))
    assert single.boxes_m[0].tobytes() == whole.boxes_m[7].tobytes()


def test_no_cluster_gives_no_box() -> None:
    for ids in (np.full(5, -1, np.int32), np.empty(0, np.int32)):
        fitted = fit_boxes(np.zeros((len(ids), 3), np.float32), ids)
        assert fitted.boxes_m.shape == (0, 7)
        assert fitted.points.shape == (0,)


def test_bad_input_is_refused() -> None:
    points = np.zeros((3, 3), np.float32)
    with pytest.raises(GeometryError, match="cluster ids"):
        fit_boxes(points, np.zeros(2, np.int32))
    with pytest.raises(GeometryError, match="cluster 1 has no points"):
        fit_boxes(points, np.array([0, 2, 2], np.int32))
    with pytest.raises(ConfigError, match="method"):
        parse_settings(BoxConfig, {"method": "ransac"}, "test")
