"""The parts of the LiDAR pair registration, each against what it must do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.lidars.free_space import agreement, what_is_seen
from percept.calib.lidars.levelling import find_planes
from percept.calib.lidars.pair import LidarCalibrationConfig, register_pair
from percept.calib.lidars.pair_spread import weak_directions
from percept.calib.lidars.registration import Stage, apply_step, linearise, refine, surface, thin
from percept.calib.limits import LidarLimits
from percept.core.errors import ConfigError, GeometryError
from percept.core.results import Verdict
from percept.core.settings import parse_settings

_F64 = NDArray[np.float64]


def _sheet(normal: int, at: float, size: float, step: float = 0.1) -> _F64:
    """Return a square sheet of points (N, 3) across one axis."""
    line = np.arange(-size, size, step)
    a, b = np.meshgrid(line, line)
    flat = np.column_stack([a.ravel(), b.ravel()])
    return np.insert(flat, normal, at, axis=1)


def _corner() -> _F64:
    return np.vstack([_sheet(2, -2, 6), _sheet(0, 7, 6), _sheet(1, -7, 6)])


def test_thinning_leaves_the_mean_of_each_voxel() -> None:
    points = np.array([[0.02, 0.02, 0.02], [0.04, 0.04, 0.04], [-0.5, 0, 0]])
    np.testing.assert_allclose(thin(points, 0.1), [[-0.5, 0, 0], [0.03, 0.03, 0.03]])


def test_normals_point_to_the_sensor() -> None:
    found = surface(_corner(), 0.3)
    towards = -(found.normals * found.points).sum(axis=1)
    assert (towards[found.is_plane] > 0).all()
    assert found.is_plane.mean() > 0.8


def test_the_gradient_is_that_of_the_cost() -> None:
    """b against finite differences of the sum of squares, with fixed neighbours."""
    target, source = (
        surface(_corner(), 0.3),
        surface(_corner() + np.array([0.02, 0.01, -0.02]), 0.3),
    )
    stage = Stage(0.2, 1e3, 1)  # a kernel so wide that all weights are one
    here = linearise(target, source, np.eye(4), stage)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-6
        there = linearise(target, source, apply_step(np.eye(4), step), stage)
        slope = (there.b[0] - here.b[0])[axis] / 1e-6
        assert slope == pytest.approx(here.H[0, axis, axis], rel=0.05)


def test_refinement_finds_a_known_step_and_copies_nothing_in_place() -> None:
    points = _corner()
    T = apply_step(np.eye(4), np.array([0.01, -0.02, 0.03, 0.1, -0.05, 0.08]))
    moved = (points - T[:3, 3]) @ T[:3, :3]
    before = moved.copy()
    pair = (surface(points, 0.2), surface(moved, 0.2))
    found = refine([pair], np.eye(4), [Stage(0.5, 0.3, 30), Stage(0.3, 0.05, 30)])
    np.testing.assert_allclose(found, T, atol=2e-3)
    np.testing.assert_array_equal(moved, before)


@pytest.mark.parametrize("tilt_deg", [0, 45, 90, 180])
def test_the_ground_is_found_at_any_tilt(tilt_deg: float) -> None:
    R = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    planes = find_planes(_sheet(2, -1.8, 15) @ R.T, 3)
    assert planes[0].height_m == pytest.approx(1.8, abs=0.02)
    np.testing.assert_allclose(planes[0].normal, R @ [0, 0, 1], atol=0.01)
    T = planes[0].levelling()
    np.testing.assert_allclose(T[:3, :3] @ R @ [0, 0, -1.8] + T[:3, 3], 0, atol=0.02)


def test_points_in_front_of_the_others_returns_are_counted() -> None:
    def seen_from(points: _F64) -> tuple[object, object]:
        smooth = surface(points, 0.2)
        return smooth, what_is_seen(points, smooth, [])

    wall, nearer = _sheet(0, 10, 4), _sheet(0, 6, 1)
    _, of_wall = seen_from(wall)
    _, of_nearer = seen_from(nearer)
    right = agreement(of_wall, of_wall, np.eye(4))  # type: ignore[arg-type]
    wrong = agreement(of_wall, of_nearer, np.eye(4))  # type: ignore[arg-type]
    assert right.violation == 0
    assert right.share > 0.95
    assert wrong.in_front > 50
    assert wrong.share == 0


def test_weak_directions_are_named_in_the_targets_axes() -> None:
    H = np.diag([100.0, 100, 100, 0.001, 3, 100])
    weak, lowest = weak_directions(H, LidarLimits())
    assert [direction.name for direction in weak] == ["forward x", "left y"]
    assert lowest == pytest.approx(1e-5)


@pytest.mark.parametrize(
    "cloud",
    [
        np.zeros((900, 3)),
        np.full((900, 3), 5.0),
        np.linspace([1, 0, 0], [40, 0, 0], 900),
        np.full((900, 3), 1e30),
        _sheet(2, -2, 6),
    ],
    ids=["zeros", "one point", "a line", "far away", "a floor"],
)
def test_clouds_that_show_nothing_never_pass(cloud: _F64) -> None:
    other = cloud[::-1] * (1 + 1e-4)
    found = register_pair([(cloud, other), (other, cloud)])
    assert found.verdict in (Verdict.BAD, Verdict.AMBIGUOUS), found.why
    assert found.why


def test_the_same_cloud_twice_is_no_pair() -> None:
    found = register_pair([(_corner(), _corner())])
    assert found.T_target_source is None
    assert "the same data" in found.why[0]


def test_wrong_shapes_and_settings_are_refused() -> None:
    with pytest.raises(GeometryError, match="a cloud is"):
        register_pair([(np.zeros((5, 2)), np.zeros((5, 3)))])
    with pytest.raises(GeometryError, match="a guess is"):
        register_pair([], initial=np.zeros(3))
    with pytest.raises(ConfigError, match="voxel_m"):
        parse_settings(LidarCalibrationConfig, {"voxel": 0.1}, "settings")
