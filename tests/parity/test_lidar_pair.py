"""LiDAR pairs of real vehicles against factory values and other tools' answers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from percept.calib.lidars.pair import register_pair
from percept.calib.lidars.pair_candidates import difference
from percept.calib.lidars.pair_result import PairRegistration
from percept.core.results import Verdict
from percept.datasets.files.cloud_files import read_point_cloud

_F64 = NDArray[np.float64]


def _cloud(path: Path) -> _F64:
    return read_point_cloud(path).points_xyz.astype(np.float64)


def _error(found: PairRegistration, T: _F64) -> tuple[float, float]:
    assert found.T_target_source is not None
    return difference(found.T_target_source, T)


def _rig(folder: Path, side: str) -> list[tuple[_F64, _F64]]:
    scenes = sorted(path for path in folder.iterdir() if path.is_dir())
    return [
        (_cloud(next(s.glob("top*.pcd"))), _cloud(next(s.glob(f"{side}*.pcd")))) for s in scenes
    ]


def _reference(folder: Path, side: str) -> list[_F64]:
    answers = json.loads((folder / "reference_gicp.json").read_text())[side]
    found = []
    for scene in sorted(answers):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", answers[scene][:3], degrees=True).as_matrix()
        T[:3, 3] = answers[scene][3:]
        found.append(T)
    return found


@pytest.mark.parametrize("side", ["left", "right"])
def test_opencalib_rig_is_found_without_a_guess(shared_data: Path, side: str) -> None:
    folder = shared_data / "lidar2lidar" / "opencalib_rig"
    found = register_pair(_rig(folder, side))
    for reference in _reference(folder, side):
        moved, turned = _error(found, reference)
        assert moved < 0.03
        assert turned < 0.2
    assert found.verdict is Verdict.GOOD, found.why
    assert found.leave_one_out is not None
    assert found.leave_one_out[0] < 0.01
    assert found.leave_one_out[1] < 0.1


def test_the_shipped_guess_45_deg_off_gives_the_same(shared_data: Path) -> None:
    scene = _rig(shared_data / "lidar2lidar" / "opencalib_rig", "right")[:1]
    guess = np.eye(4)
    guess[:3, :3] = Rotation.from_euler("z", -90, degrees=True).as_matrix()
    guess[:3, 3] = -0.00013, -0.46328, -0.46603
    without = register_pair(scene)
    assert without.T_target_source is not None
    moved, turned = _error(register_pair(scene, initial=guess), without.T_target_source)
    assert moved < 1e-3
    assert turned < 1e-2


def test_av2_upside_down_unit_agrees_with_the_factory(shared_data: Path) -> None:
    folder = shared_data / "lidar2lidar" / "av2_rig_7fab2350"
    factory = np.array(json.loads((folder / "ground_truth.json").read_text())["T_up_from_down"])
    found = register_pair(
        [(_cloud(folder / "sweep0" / "up.pcd"), _cloud(folder / "sweep0" / "down.pcd"))]
    )
    moved, turned = _error(found, factory)
    assert moved < 0.06
    assert turned < 0.15
    assert found.verdict is Verdict.DOUBTFUL


def test_small_gicp_pair_agrees_with_its_truth(shared_data: Path) -> None:
    folder = shared_data / "lidar2lidar" / "small_gicp_pair"
    found = register_pair([(_cloud(folder / "target.ply"), _cloud(folder / "source.ply"))])
    moved, turned = _error(found, np.loadtxt(folder / "T_target_source.txt"))
    assert moved < 0.03
    assert turned < 0.5
    assert found.verdict is Verdict.DOUBTFUL


_KITTI = "odometry/kitti00_velodyne/000000.bin"
_TOP_1, _TOP_2 = (f"lidar2lidar/opencalib_rig/{scene}" for scene in ("0001", "0002"))
_WRONG = [
    (_KITTI, f"{_TOP_1}/top.pcd"),
    (f"{_TOP_1}/top.pcd", f"{_TOP_2}/left-2022-02-15-17-36-04-414.pcd"),
    (_KITTI, "camera_lidar/acfr_vlp/clouds/pose1.pcd"),
    ("lidar2lidar/multi_lica/points_horizontal.pcd", "camera_lidar/acfr_vlp/clouds/pose1.pcd"),
]


@pytest.mark.parametrize(("target", "source"), _WRONG)
def test_clouds_of_different_places_do_not_pass(
    shared_data: Path, target: str, source: str
) -> None:
    found = register_pair([(_cloud(shared_data / target), _cloud(shared_data / source))])
    assert found.verdict.exit_code == 4, found


def test_two_halves_of_a_scan_do_not_pass(shared_data: Path) -> None:
    scan = _cloud(shared_data / _KITTI)
    found = register_pair([(scan[scan[:, 1] > 0], scan[scan[:, 1] < 0])])
    assert found.verdict.exit_code == 4, found
