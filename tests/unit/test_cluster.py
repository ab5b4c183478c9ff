"""Exact single-linkage clustering."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from percept.core.errors import ConfigError, GeometryError
from percept.core.settings import parse_settings
from percept.lidar.cluster import MAX_GROWTH, ClusterConfig, cluster_points

Cloud = NDArray[np.float32]


def _by_brute_force(points: Cloud, config: ClusterConfig) -> NDArray[np.int32]:
    """Label components of the graph of all pairs, numbered by their first points."""
    wide = points.astype(np.float64)
    offsets = wide[:, None] - wide[None, :]
    square = offsets[..., 0] ** 2 + offsets[..., 1] ** 2 + offsets[..., 2] ** 2
    ranges = np.sqrt(wide[:, 0] ** 2 + wide[:, 1] ** 2)
    reach = config.tolerance_m + config.range_growth * np.minimum(ranges[:, None], ranges)
    reach = np.minimum(reach, config.tolerance_m * MAX_GROWTH)
    _, labels = connected_components(square <= reach * reach, directed=False)
    _, first = np.unique(labels, return_index=True)
    number = np.empty(len(first), np.int32)
    number[labels[np.sort(first)]] = np.arange(len(first))
    numbered: NDArray[np.int32] = number[labels]
    return numbered


def _random_cloud(seed: int, spread_m: float, count: int = 600) -> Cloud:
    random = np.random.default_rng(seed)
    return random.uniform(-spread_m, spread_m, (count, 3)).astype(np.float32)


@pytest.mark.parametrize("growth", [0.0, 0.005, 0.05])
@pytest.mark.parametrize("spread_m", [1.5, 4.0, 30.0])
@pytest.mark.parametrize("tolerance_m", [0.3, 0.5, 2.0])
def test_clusters_equal_the_graph_of_all_pairs(
    tolerance_m: float, spread_m: float, growth: float
) -> None:
    config = ClusterConfig(tolerance_m=tolerance_m, range_growth=growth)
    points = _random_cloud(int(100 * spread_m), spread_m)
    points[300:, 2] = 0.0  # a flat half, as on streets
    np.testing.assert_array_equal(cluster_points(points, config), _by_brute_force(points, config))


def test_a_gap_of_just_the_tolerance_joins() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0000001, 0.0, 0.0]], np.float32)
    assert cluster_points(points, ClusterConfig(tolerance_m=0.5)).tolist() == [0, 0, 1]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_chains_along_each_axis_hold_and_break(axis: int) -> None:
    steps = np.concatenate([np.arange(0.0, 30.0, 0.49), np.arange(30.5, 60.0, 0.49)])
    points = np.zeros((len(steps), 3), np.float32)
    points[:, axis] = steps - 20.0
    labels = cluster_points(points, ClusterConfig(tolerance_m=0.5))
    expected = (steps > 30.1).astype(int)
    np.testing.assert_array_equal(labels, expected)


def test_the_order_of_points_changes_only_the_numbers() -> None:
    points = _random_cloud(5, 4.0)
    config = ClusterConfig(tolerance_m=0.5)
    labels = cluster_points(points, config)
    order = np.random.default_rng(6).permutation(len(points))
    shuffled = cluster_points(points[order], config)
    pairs = np.unique(np.stack([labels[order], shuffled]), axis=1)
    assert pairs.shape[1] == labels.max() + 1 == shuffled.max() + 1
    _, first = np.unique(shuffled, return_index=True)
    assert (np.diff(first) > 0).all()


def test_small_and_large_groups_are_none_and_the_rest_is_numbered_without_gaps() -> None:
    sizes = [1, 4, 2, 30, 5]
    points = np.concatenate(
        [np.full((size, 3), 5.0 * k, np.float32) for k, size in enumerate(sizes)]
    )
    labels = cluster_points(points, ClusterConfig(min_points=3, max_points=10))
    assert labels.tolist() == [-1] + [0] * 4 + [-1] * 2 + [-1] * 30 + [1] * 5


def test_tolerance_grows_with_the_range_of_the_nearer_point() -> None:
    # At 40 m the tolerance is 0.9 m; the nearer point's range is what counts.
    gap = np.array([[40.0, 0.0, 0.0], [40.89, 0.0, 0.0], [41.8, 0.0, 0.0]], np.float32)
    config = ClusterConfig(tolerance_m=0.5, range_growth=0.01)
    assert cluster_points(gap, config).tolist() == [0, 0, 1]
    assert cluster_points(gap, ClusterConfig(tolerance_m=0.5)).tolist() == [0, 1, 2]


def test_many_points_at_one_place_are_one_cluster() -> None:
    labels = cluster_points(np.full((100_000, 3), 7.7, np.float32))
    assert labels.max() == labels.min() == 0


def test_far_coordinates_and_wide_heights_stay_exact() -> None:
    # float32 has steps of 1/16 m out here, so that distances are multiples of it.
    far = _random_cloud(8, 3.0, 300) + np.float32(1e6)
    config = ClusterConfig(tolerance_m=0.5)
    np.testing.assert_array_equal(cluster_points(far, config), _by_brute_force(far, config))
    tall = _random_cloud(9, 3.0, 300)
    tall[::2, 2] += np.float32(5e5)
    np.testing.assert_array_equal(cluster_points(tall, config), _by_brute_force(tall, config))
    assert cluster_points(_random_cloud(10, 1e6), ClusterConfig(range_growth=0.1)).max() == 599


def test_no_points_and_one_point() -> None:
    empty = cluster_points(np.empty((0, 3), np.float32))
    assert empty.shape == (0,)
    assert empty.dtype == np.dtype(np.int32)
    assert cluster_points(np.ones((1, 3), np.float32)).tolist() == [0]
    assert cluster_points(np.ones((1, 4)), ClusterConfig(min_points=2)).tolist() == [-1]


def test_points_that_the_grid_cannot_hold_are_refused() -> None:
    with pytest.raises(GeometryError, match="too far"):
        cluster_points(np.array([[0.0, 0.0, 1e9]], np.float32))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_nowhere_are_in_no_cluster(value: float) -> None:
    cloud = _random_cloud(500, 10.0)
    holed = np.insert(cloud, [0, 250, 500], [value, 0, 0], axis=0)
    labels = cluster_points(holed)
    nowhere = ~np.isfinite(holed).all(axis=1)
    assert set(labels[nowhere]) == {-1}
    np.testing.assert_array_equal(labels[~nowhere], cluster_points(cloud))
    assert cluster_points(np.full((4, 3), value)).tolist() == [-1] * 4


def test_map_coordinates_in_float64_cluster_as_near_ones_do() -> None:
    cloud = _random_cloud(2000, 20.0).astype(np.float64)
    np.testing.assert_array_equal(
        cluster_points(cloud + np.array([4.5e5, 4.8e6, 200.0])), cluster_points(cloud)
    )


@pytest.mark.parametrize(
    "values",
    [{"tolerance_m": 0.0}, {"min_points": 0}, {"min_points": 5, "max_points": 4}, {"tolerence": 1}],
)
def test_settings_that_cannot_be_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError):
        parse_settings(ClusterConfig, values, where="test")
