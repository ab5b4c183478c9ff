"""Laws of transforms, quaternions, trees and trajectories."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.trajectory import Trajectory
from percept.core.transform import (
    Transform,
    matrix_from_quat_xyzw,
    quat_xyzw_from_matrix,
    rotation_from_rpy,
)
from percept.core.transform_tree import TransformTree

_ANGLES = st.floats(-np.pi, np.pi)
_ROTATIONS = st.builds(rotation_from_rpy, _ANGLES, _ANGLES, _ANGLES)


def _transform(target: str, source: str, seed: int) -> Transform:
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*rng.uniform(-3, 3, 3))
    matrix[:3, 3] = rng.uniform(-10, 10, 3)
    return Transform(target, source, matrix)


@given(_ROTATIONS)
def test_quaternion_round_trip(rotation: NDArray[np.float64]) -> None:
    quat = quat_xyzw_from_matrix(rotation)
    assert quat[3] >= 0
    np.testing.assert_allclose(matrix_from_quat_xyzw(quat), rotation, atol=1e-12)


def test_quaternion_of_a_quarter_turn_about_z_maps_x_to_y() -> None:
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        matrix_from_quat_xyzw([0, 0, half, half]) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


def test_composition_reads_right_to_left() -> None:
    T_a_b, T_b_c = _transform("a", "b", 1), _transform("b", "c", 2)
    points_c = np.random.default_rng(3).normal(size=(5, 3))
    T_a_c = T_a_b @ T_b_c
    assert (T_a_c.target, T_a_c.source) == ("a", "c")
    np.testing.assert_allclose(T_a_c.apply(points_c), T_a_b.apply(T_b_c.apply(points_c)))
    np.testing.assert_allclose((T_a_c.inverse() @ T_a_c).matrix, np.eye(4), atol=1e-12)


def test_frames_that_do_not_meet_are_refused() -> None:
    with pytest.raises(GeometryError, match="do not meet"):
        _transform("a", "b", 1) @ _transform("c", "d", 2)


@pytest.mark.parametrize(
    "matrix",
    [np.eye(3), 2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan)],
    ids=["shape", "scale", "mirror", "nan"],
)
def test_what_is_not_rigid_is_refused(matrix: NDArray[np.float64]) -> None:
    with pytest.raises(GeometryError):
        Transform("a", "b", matrix)


def test_tree_connects_siblings_through_their_parent() -> None:
    tree = TransformTree()
    T_base_top, T_base_left = _transform("base_link", "top", 1), _transform("base_link", "left", 2)
    tree.add(T_base_top, 0, static=True)
    tree.add(T_base_left, 0, static=True)
    found = tree.lookup("top", "left")
    assert found is not None
    np.testing.assert_allclose(
        found.matrix, (T_base_top.inverse() @ T_base_left).matrix, atol=1e-12
    )
    assert tree.lookup("top", "nowhere") is None
    assert tree.roots() == ("base_link",)


def test_tree_takes_the_dynamic_edge_nearest_in_time() -> None:
    tree = TransformTree()
    for stamp_ns, x in ((0, 0.0), (100, 1.0), (200, 2.0)):
        matrix = np.eye(4)
        matrix[0, 3] = x
        tree.add(Transform("odom", "base_link", matrix), stamp_ns, static=False)
    at_130 = tree.lookup("odom", "base_link", 130)
    at_170 = tree.lookup("odom", "base_link", 170)
    latest = tree.lookup("odom", "base_link")
    assert at_130 is not None
    assert at_170 is not None
    assert latest is not None
    assert at_130.translation_m[0] == 1.0
    assert at_170.translation_m[0] == 2.0
    assert latest.translation_m[0] == 2.0


def test_tree_names_a_child_with_two_parents_and_refuses_a_cycle() -> None:
    tree = TransformTree()
    tree.add(Transform.identity("a", "b"), 0, static=True)
    tree.add(Transform.identity("c", "b"), 0, static=True)
    assert tree.conflicts == ["frame 'b' has two parents: 'a' and 'c'"]
    tree.add(Transform.identity("b", "c"), 0, static=True)
    with pytest.raises(GeometryError, match="cycle"):
        tree.lookup("x", "b")


def test_tree_draws_itself() -> None:
    tree = TransformTree()
    tree.add(Transform.identity("odom", "base_link"), 0, static=False)
    tree.add(Transform.identity("base_link", "imu"), 0, static=True)
    tree.add(Transform.identity("base_link", "top"), 0, static=True)
    assert tree.as_text().splitlines() == [
        "odom",
        "└─ base_link (dynamic)",
        "   ├─ imu (static)",
        "   └─ top (static)",
    ]


def test_trajectory_interpolates_on_the_shortest_arc() -> None:
    matrices = np.stack([np.eye(4), np.eye(4)])
    matrices[1, :3, :3] = rotation_from_rpy(0, 0, 1.0)
    matrices[1, 0, 3] = 4.0
    trajectory = Trajectory("map", "base_link", np.array([0, 1000]), matrices)
    middle = trajectory.at(250)
    assert middle is not None
    np.testing.assert_allclose(middle.rotation, rotation_from_rpy(0, 0, 0.25), atol=1e-12)
    assert middle.translation_m[0] == 1.0
    assert trajectory.at(1001) is None
    with pytest.raises(GeometryError, match="rise"):
        Trajectory("map", "base_link", np.array([0, 0]), matrices)


def test_trajectory_turns_through_the_half_circle_the_short_way() -> None:
    # The two quaternions lie in opposite halves: w >= 0 in both, but z changes its sign.
    matrices = np.stack([np.eye(4), np.eye(4)])
    matrices[0, :3, :3] = rotation_from_rpy(0, 0, np.pi - 0.2)
    matrices[1, :3, :3] = rotation_from_rpy(0, 0, np.pi + 0.4)
    middle = Trajectory("map", "base_link", np.array([0, 1000]), matrices).at(500)
    assert middle is not None
    np.testing.assert_allclose(middle.rotation, rotation_from_rpy(0, 0, np.pi + 0.1), atol=1e-12)
