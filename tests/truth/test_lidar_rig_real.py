"""A real rig of three LiDARs without a guess, against another tool's answer for each scene."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from percept.calib.lidars.calibrate import calibrate_lidars
from percept.calib.lidars.rig_graph import relative_motion
from percept.core.transform import rotation_from_rpy
from percept.datasets import read_point_cloud


def test_both_side_lidars_are_right_without_a_guess(shared_data: Path) -> None:
    folder = shared_data / "lidar2lidar" / "opencalib_rig"
    reference = json.loads((folder / "reference_gicp.json").read_text())
    scenes = [
        {
            name: read_point_cloud(next(scene.glob(f"{name}*.pcd"))).points_xyz
            for name in ("top", "left", "right")
        }
        for scene in (folder / "0001", folder / "0002")
    ]
    result = calibrate_lidars(scenes, "top")
    assert result.verdict.exit_code == 0
    for e in result.extrinsics:
        expected = np.mean([reference[e.sensor][scene] for scene in ("0001", "0002")], axis=0)
        T = np.eye(4)
        T[:3, :3] = rotation_from_rpy(*np.radians(expected[:3]))
        T[:3, 3] = expected[3:]
        assert e.T_reference_sensor is not None
        motion = relative_motion(T, e.T_reference_sensor)
        assert np.degrees(np.linalg.norm(motion[:3])) < 0.2
        assert np.linalg.norm(motion[3:]) < 0.03
        assert e.leave_one_out_translation_m == pytest.approx(0, abs=0.02)
        assert e.scenes_agreeing == "2/2"
    (loop,) = result.loops
    assert loop.agrees
