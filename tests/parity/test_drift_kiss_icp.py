"""Drift measures against those of the kiss_icp package."""

from __future__ import annotations

import numpy as np
import pytest
from kiss_icp import metrics
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.core.trajectory import Trajectory
from percept.odometry.drift import measure_drift, stretch_errors


def _walk(steps: int, noise: float, seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for n in range(steps):
        step = np.eye(4)
        turn = [0.0, 0.0, 0.02 * np.sin(n / 50)] + noise * rng.normal(0, 1e-3, 3)
        step[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        step[:3, 3] = [1.0, 0.0, 0.0] + noise * rng.normal(0, 0.02, 3)
        poses.append(poses[-1] @ step)
    return np.stack(poses)


@pytest.mark.parametrize("seed", range(3))
def test_relative_and_absolute_errors_are_those_of_kiss_icp(seed: int) -> None:
    true, found = _walk(1500, 0.0, seed), _walk(1500, 1.0, seed)
    percent, degpm = metrics.sequence_error(true, found)
    rotation_rad, translation_m = metrics.absolute_trajectory_error(true, found)
    rows = stretch_errors(true, found)
    assert len(rows) > 500
    # It sums in single precision, and its angles come from the cosine of small ones.
    assert 100 * rows[:, 1].mean() == pytest.approx(percent, rel=1e-5)
    assert np.degrees(rows[:, 2].mean()) == pytest.approx(degpm, rel=2e-3)
    stamps_ns = np.arange(len(true), dtype=np.int64) * 100_000_000
    drift = measure_drift(
        Trajectory("odom", "base_link", stamps_ns, found),
        Trajectory("map", "base_link", stamps_ns, true),
    )
    assert drift.ate_m == pytest.approx(translation_m, rel=1e-6)
    assert drift.ate_deg == pytest.approx(np.degrees(rotation_rad), rel=1e-3)
    assert drift.translation_percent == pytest.approx(percent, rel=1e-5)
