"""`percept calib lidar` from files to the document, with nothing made up but the yard."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.core.transform import rotation_from_rpy

Matrix = NDArray[np.float64]


def _pose(x: float, y: float, z: float, yaw: float = 0.0) -> Matrix:
    T = np.eye(4)
    T[:3, :3] = rotation_from_rpy(0.05, 0.1, yaw)
    T[:3, 3] = x, y, z
    return T


def test_two_lidars_in_a_yard_are_placed_by_the_command_itself(tmp_path: Path) -> None:
    T_top_left = _pose(0.1, 0.9, -0.4, 2.0)
    flags = []
    for scene in range(3):
        for name, place in (("top", np.eye(4)), ("left", T_top_left)):
            path = tmp_path / f"{name}{scene}.npy"
            np.save(path, _yard(scene, place))
            flags += ["--cloud", f"{name}={path}"]
    command = [sys.executable, "-m", "percept.cli", "calib", "lidar", *flags]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "run"), "--json"],
        capture_output=True, text=True, env={**os.environ, "PYTHONWARNINGS": "error"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (entry,) = json.loads(done.stdout)["extrinsics"]
    error = np.linalg.inv(T_top_left) @ np.array(entry["T_reference_sensor"])
    angle_deg = np.degrees(np.arccos(np.clip((np.trace(error[:3, :3]) - 1) / 2, -1, 1)))
    assert np.linalg.norm(error[:3, 3]) < 0.005
    assert angle_deg < 0.05
    assert entry["scenes_agreeing"] == "3/3"


def _yard(scene: int, T_top_sensor: Matrix) -> NDArray[np.float32]:
    """Return what a spinning LiDAR sees of a floor and boxes: rays met with planes exactly."""
    rng = np.random.default_rng(scene)
    boxes = rng.uniform([-14, -14, 0.5, 0.5, 0.8], [14, 14, 4, 4, 4], size=(14, 5))
    boxes = boxes[np.hypot(boxes[:, 0], boxes[:, 1]) > 6]
    azimuth, elevation = np.meshgrid(np.arange(0, 360, 0.5), np.linspace(-25, 12, 40))
    a, e = np.radians(azimuth.ravel()), np.radians(elevation.ravel())
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    origin = T_top_sensor[:3, 3] + [0, 0, 2.0]
    directions = rays @ T_top_sensor[:3, :3].T
    down = np.minimum(directions[:, 2], -1e-9)
    ranges = -origin[2] / down
    for x, y, width, depth, height in boxes:
        low = np.array([x - width / 2, y - depth / 2, 0])
        high = np.array([x + width / 2, y + depth / 2, height])
        with np.errstate(divide="ignore", invalid="ignore"):
            near, far = (low - origin) / directions, (high - origin) / directions
        first = np.nanmax(np.minimum(near, far), axis=1)
        last = np.nanmin(np.maximum(near, far), axis=1)
        ranges = np.where((first <= last) & (first > 0), np.minimum(ranges, first), ranges)
    seen = ranges < 40
    noise = rng.normal(scale=0.01, size=seen.sum())
    return np.asarray((ranges[seen] + noise)[:, None] * rays[seen], dtype=np.float32)
