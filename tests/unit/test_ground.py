"""Ground segmentation: what it must label, on slopes, and the defects of a known implementation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from percept.core.errors import ConfigError, GeometryError
from percept.core.settings import parse_settings
from percept.lidar.ground import GroundConfig, segment_ground

Cloud = NDArray[np.float32]
_HEIGHT_M = 1.8
# One ray at a time: no neighbour may help out.
_ALONE = GroundConfig(sensor_height_m=_HEIGHT_M, line_search_angle_rad=0.0)


def _ray(r_m: list[float], z_m: list[float], azimuth_rad: float = 0.3) -> Cloud:
    r = np.array(r_m)
    x, y = r * np.cos(azimuth_rad), r * np.sin(azimuth_rad)
    return np.stack([x, y, np.array(z_m)], axis=1).astype(np.float32)


def _plane_scan(slope_x: float = 0.0, slope_y: float = 0.0) -> Cloud:
    """Return what 48 beams see of the plane z = -height + slope . xy, up to 60 m."""
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(0.0, 360.0, 0.5)), np.radians(np.linspace(-25.0, -1.0, 48))
    )
    towards = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    ).reshape(3, -1)
    closing = towards[2] - slope_x * towards[0] - slope_y * towards[1]
    with np.errstate(divide="ignore"):
        scan = (towards * np.where(closing < 0, -_HEIGHT_M / closing, np.inf)).T
    near: Cloud = scan[np.hypot(scan[:, 0], scan[:, 1]) < 60.0].astype(np.float32)
    return near


def _pillar(x_m: float, y_m: float, ground_z: float) -> Cloud:
    z = np.linspace(ground_z + 0.4, ground_z + 2.0, 20)
    return np.stack([np.full(20, x_m), np.full(20, y_m), z], axis=1).astype(np.float32)


def test_the_last_line_of_a_segment_counts() -> None:
    ray = _ray([4.0, 5.0, 6.0, 7.0, 8.0], [-_HEIGHT_M] * 5)
    assert segment_ground(ray, _ALONE).all()


def test_two_points_are_no_line() -> None:
    ray = _ray([4.0, 5.0], [-_HEIGHT_M] * 2)
    assert not segment_ground(ray, _ALONE).any()


def test_the_point_that_breaks_a_line_starts_the_next() -> None:
    # The ramp has two prototypes of its own: without the one that broke the flat line, or
    # without the flat line's last one, it is no line.
    flat, ramp = [4.0, 5.0, 6.0, 7.0, 8.0], [12.0, 16.0]
    rise = [-_HEIGHT_M + 0.2 * (r - 8.0) for r in ramp]
    labels = segment_ground(_ray(flat + ramp, [-_HEIGHT_M] * 5 + rise), _ALONE)
    assert labels.tolist() == [True] * 7


def test_a_long_gap_is_bridged_only_to_where_the_line_leads() -> None:
    # A step of 0.3 m behind the gap would still fit a line through all: the gap makes it long.
    flat, beyond = [2.0, 4.0, 6.0, 8.0], [20.0]
    ray = _ray(flat + beyond, [-_HEIGHT_M] * 4 + [-_HEIGHT_M + 0.3])
    assert segment_ground(ray, _ALONE).tolist() == [True] * 4 + [False]
    near = _ALONE.model_copy(update={"long_threshold_m": 15.0})
    assert segment_ground(ray, near).all()


def test_each_point_is_judged_at_its_own_range() -> None:
    # On a slope, a label computed with another point's range is wrong; shuffling separates them.
    scan = np.concatenate([_plane_scan(slope_x=0.1), _pillar(12.0, 5.0, -0.6)])
    order = np.random.default_rng(1).permutation(len(scan))
    config = GroundConfig(sensor_height_m=_HEIGHT_M)
    labels = segment_ground(scan[order], config)
    np.testing.assert_array_equal(labels, segment_ground(scan, config)[order])
    assert labels[order < len(scan) - 20].mean() > 0.99


@pytest.mark.parametrize(
    ("slope_x", "slope_y"), [(0.0, 0.0), (0.1, 0.0), (0.0, -0.1), (0.07, 0.07), (0.0875, 0.0)]
)
def test_a_slope_of_10_percent_or_a_tilt_of_5_deg_is_ground(slope_x: float, slope_y: float) -> None:
    scan = _plane_scan(slope_x, slope_y)
    noisy = scan + np.random.default_rng(2).normal(0.0, 0.015, scan.shape)
    places = [(8.0, 3.0), (-10.0, 6.0), (4.0, -12.0), (20.0, 0.0)]
    pillars = np.concatenate(
        [_pillar(x, y, -_HEIGHT_M + slope_x * x + slope_y * y) for x, y in places]
    )
    cloud = np.concatenate([noisy.astype(np.float32), pillars])
    labels = segment_ground(cloud, GroundConfig(sensor_height_m=_HEIGHT_M))
    assert labels[: len(scan)].mean() > 0.995
    assert not labels[len(scan) :].any()


def test_a_ramp_that_begins_ahead_is_followed() -> None:
    flat = _plane_scan()
    ramp = flat.copy()
    beyond = np.maximum(ramp[:, 0] - 15.0, 0.0)
    ramp[:, 2] += 0.1 * beyond
    labels = segment_ground(ramp, GroundConfig(sensor_height_m=_HEIGHT_M))
    assert labels[beyond > 0].mean() > 0.92  # rings are 8 m apart where it bends


def test_a_car_roof_and_a_table_are_no_ground() -> None:
    scan = _plane_scan()
    roof = np.zeros((400, 3), np.float32)
    roof[:, 0] = np.repeat(np.linspace(8.0, 12.0, 20), 20)
    roof[:, 1] = np.tile(np.linspace(-0.9, 0.9, 20), 20)
    roof[:, 2] = -_HEIGHT_M + 1.5
    hidden = (np.abs(scan[:, 1]) < 1.0) & (scan[:, 0] > 7.0) & (scan[:, 0] < 30.0)
    labels = segment_ground(
        np.concatenate([scan[~hidden], roof]), GroundConfig(sensor_height_m=_HEIGHT_M)
    )
    assert not labels[-400:].any()


def test_reflections_below_the_ground_do_not_take_it_away() -> None:
    scan = _plane_scan()
    random = np.random.default_rng(3)
    low = scan[random.choice(len(scan), 60, replace=False)].copy()
    low[:, 2] -= random.uniform(0.5, 3.0, 60).astype(np.float32)
    cloud = np.concatenate([scan, low])
    labels = segment_ground(cloud, GroundConfig(sensor_height_m=_HEIGHT_M))
    assert labels[: len(scan)].mean() > 0.98
    assert not labels[len(scan) :].any()


def test_points_outside_the_range_limits_are_not_ground() -> None:
    scan = _plane_scan()
    config = GroundConfig(sensor_height_m=_HEIGHT_M, r_min_m=6.0, r_max_m=20.0)
    ranges = np.hypot(scan[:, 0], scan[:, 1])
    labels = segment_ground(scan, config)
    assert not labels[(ranges <= 6.0) | (ranges >= 20.0)].any()
    assert labels[(ranges > 6.1) & (ranges < 19.9)].all()


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        np.array([[5.0, 0.0, -1.8]]),
        np.tile([[5.0, 0.0, -1.8]], (1000, 1)),
        np.zeros((10, 3)),
        np.array([[-5.0, 0.0, -1.8], [-5.0, -0.0, -1.8]]),  # an angle of exactly pi and -pi
        np.array([[3e38, 3e38, 3e38]]),
    ],
)
def test_too_little_to_fit_a_line_is_no_ground(points: NDArray[np.float64]) -> None:
    labels = segment_ground(points.astype(np.float32), GroundConfig())
    assert labels.shape == (len(points),)
    assert labels.dtype == np.bool_
    assert not labels.any()


def test_extra_columns_and_read_only_input_are_welcome() -> None:
    scan = _plane_scan()
    wide = np.column_stack([scan, np.ones(len(scan))])
    wide.setflags(write=False)
    config = GroundConfig(sensor_height_m=_HEIGHT_M)
    np.testing.assert_array_equal(segment_ground(wide, config), segment_ground(scan, config))


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.zeros(3)])
def test_what_is_no_cloud_is_refused(points: NDArray[np.float64]) -> None:
    with pytest.raises(GeometryError, match=r"\(N, 3\)"):
        segment_ground(points, GroundConfig())


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_points_that_are_nowhere_are_no_ground_and_change_nothing(value: float) -> None:
    scan = _plane_scan()
    config = GroundConfig(sensor_height_m=_HEIGHT_M)
    holed = np.insert(scan, [0, 100, len(scan)], value, axis=0)
    labels = segment_ground(holed, config)
    nowhere = ~np.isfinite(holed).all(axis=1)
    assert nowhere.sum() == 3
    assert not labels[nowhere].any()
    np.testing.assert_array_equal(labels[~nowhere], segment_ground(scan, config))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("sensor_height_m", 7.0),
        ("sensor_height_m", -0.5),
        ("segments", 0),
        ("bins", 1),
        ("max_slope", 0.0),
        ("r_max_m", 0.2),
        ("min_slope", 0.9),
        ("max_dist_to_line_m", float("nan")),
        ("height", 1.7),
    ],
)
def test_settings_that_cannot_be_are_refused(key: str, value: float) -> None:
    with pytest.raises(ConfigError):
        parse_settings(GroundConfig, {key: value}, where="test")
