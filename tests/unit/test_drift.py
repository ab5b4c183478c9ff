"""Drift: hand-worked numbers."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.errors import GeometryError, InsufficientDataError
from percept.core.trajectory import Trajectory
from percept.odometry.drift import align_poses, measure_drift


def _line(count: int, step_m: float) -> NDArray[np.float64]:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = step_m * np.arange(count)
    return poses


def _on(matrices: NDArray[np.float64], first_ns: int = 0, source: str = "base_link") -> Trajectory:
    stamps_ns = first_ns + np.arange(len(matrices), dtype=np.int64) * 1000
    return Trajectory("odom", source, stamps_ns, matrices)


def test_a_wheel_that_is_two_percent_too_large_drifts_two_percent() -> None:
    drift = measure_drift(_on(_line(251, 1.02)), _on(_line(251, 1.0)))
    assert [s.length_m for s in drift.stretches] == [100.0, 200.0]
    # A stretch ends at the first pose beyond its length: after 101 and 201 m.
    assert [s.translation_percent for s in drift.stretches] == pytest.approx([2.02, 2.01])
    assert drift.end_m == pytest.approx(5.0)
    assert drift.rpe_m == pytest.approx(0.02)
    assert drift.rotation_degpm == pytest.approx(0, abs=1e-9)
    assert drift.way_m == pytest.approx(250)


def test_a_short_way_has_short_stretches_and_a_shorter_one_none() -> None:
    short = measure_drift(_on(_line(40, 1.1)), _on(_line(40, 1.0)))
    assert [s.length_m for s in short.stretches] == [10.0, 20.0]
    none = measure_drift(_on(_line(5, 1.1)), _on(_line(5, 1.0)))
    assert (none.stretches, none.translation_percent) == ((), None)
    assert none.end_m == pytest.approx(0.4)


@pytest.mark.parametrize("alignment", ["se3", "yaw", "first"])
def test_a_way_that_is_only_turned_and_moved_has_no_error(alignment: str) -> None:
    rng = np.random.default_rng(0)
    true = _line(30, 1.0)
    true[:, :3, 3] += rng.normal(0, 5, (30, 3))
    true[:, :3, :3] = Rotation.random(30, rng=rng).as_matrix()
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, 2.5]).as_matrix()
    T[:3, 3] = [100, -20, 3]
    drift = measure_drift(_on(T @ true), _on(true), alignment=alignment)  # type: ignore[arg-type]
    assert drift.ate_m == pytest.approx(0, abs=1e-9)
    assert drift.ate_deg == pytest.approx(0, abs=1e-5)
    tilted = np.eye(4)
    tilted[:3, :3] = Rotation.from_rotvec([0.3, 0, 0]).as_matrix()
    off = np.abs(align_poses(true, tilted @ true, alignment) - true).max()  # type: ignore[arg-type]
    assert (off > 0.1) == (alignment == "yaw")


def test_trajectories_that_cannot_be_compared_are_refused() -> None:
    with pytest.raises(InsufficientDataError, match="share no span"):
        measure_drift(_on(_line(5, 1.0)), _on(_line(5, 1.0), first_ns=10**9))
    with pytest.raises(GeometryError, match="'lidar'"):
        measure_drift(_on(_line(5, 1.0), source="lidar"), _on(_line(5, 1.0)))
