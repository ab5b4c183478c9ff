"""Rigs of LiDARs at places of the synthetic street, against the exact rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hostile.case import pose
from hostile.lidar_worlds import TOP, rays, scan, street
from numpy.typing import NDArray

from percept.calib.lidars.calibrate import calibrate_lidars
from percept.calib.lidars.evidence import RigEvidence
from percept.calib.lidars.judgement import conclude
from percept.calib.lidars.pair import LidarCalibrationConfig, register_views, view_of
from percept.calib.lidars.result import LidarCalibration
from percept.calib.lidars.rig_graph import relative_motion
from percept.calib.lidars.scenes import prepare_scenes
from percept.calib.limits import LidarLimits
from percept.core.results import Verdict
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.drive import Drive, DriveConfig
from percept.datasets.synthetic.ego import EGO_LANE_Y_M, Motion
from percept.datasets.synthetic.lidar import LidarModel, scan_world

Matrix = NDArray[np.float64]
Scenes = list[dict[str, Matrix]]

_CENTIMETRE = 0.5  # of range noise, on the scale of the synthetic LiDARs
_PLACES_M = (40.0, 75.0, 110.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Parked(Motion):
    """A vehicle that stands at a place of the street, turned a little."""

    x_m: float = 0.0
    yaw_rad: float = 0.0

    def seconds(self, stamp_ns: Any) -> Matrix:
        """Stop the clock, so that traffic stands: its way between two scans is no error."""
        return np.full(np.shape(stamp_ns), 5.0)

    def _plane(self, time_s: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        y, x, yaw = (np.full(len(time_s), v) for v in (EGO_LANE_Y_M, self.x_m, self.yaw_rad))
        return x, y, yaw


def _capture(seed: int, share: float, names: Any) -> tuple[Scenes, dict[str, Matrix]]:
    """Return scenes of the named LiDARs, and `T_reference_sensor` with the first as reference."""
    drive = Drive(DriveConfig(seed=seed, seconds=1, beam_share=share, cameras=()))
    models = {m.name.removeprefix("lidar_"): m for m in drive.lidars}
    models["right"] = _upside_down(models["right"])
    scenes: Scenes = []
    for place, x_m in enumerate(_PLACES_M):
        parked = _Parked(drive.ego.profile, drive.ego.start_ns, x_m, 0.1 * (place - 1))
        scene = {}
        for number, name in enumerate(names):
            rng = np.random.default_rng([seed, place, number])
            stamp_ns = drive.scan_stamp_ns(models[name], 5)
            scan = scan_world(models[name], drive.world, parked, stamp_ns, _CENTIMETRE, rng)
            scene[name] = scan.points_sensor
        scenes.append(scene)
    T_base = {name: models[name].T_base_sensor.matrix for name in names}
    return scenes, {name: np.linalg.inv(T_base[names[0]]) @ T_base[name] for name in names}


def _upside_down(model: LidarModel) -> LidarModel:
    matrix = model.T_base_sensor.matrix.copy()
    matrix[:3, :3] = matrix[:3, :3] @ rotation_from_rpy(np.pi, 0, 0)
    placed = Transform(model.T_base_sensor.target, model.T_base_sensor.source, matrix)
    return replace(model, T_base_sensor=placed)


def _errors(result: LidarCalibration, truth: dict[str, Matrix]) -> dict[str, Matrix]:
    """Return errors (2, 6): of the place (rad, m), and in standard deviations."""
    errors = {}
    for e in result.extrinsics:
        assert e.T_reference_sensor is not None
        motion = relative_motion(truth[e.sensor], e.T_reference_sensor)
        sd = np.concatenate([np.radians(e.sd_rotation_deg), e.sd_translation_m])
        errors[e.sensor] = np.stack([motion, motion / sd])
    return errors


def test_a_rig_with_one_lidar_upside_down_is_recovered() -> None:
    scenes, truth = _capture(0, 1.0, ("top", "left", "right"))
    result = calibrate_lidars(scenes, "top")
    assert result.verdict.exit_code == 0
    for motion, in_sd in _errors(result, truth).values():
        assert np.degrees(np.linalg.norm(motion[:3])) < 0.02
        assert np.linalg.norm(motion[3:]) < 0.002
        assert np.abs(in_sd).max() < 5
    (loop,) = result.loops
    assert loop.agrees
    assert loop.translation_m < 0.01


@pytest.mark.slow
def test_clouds_of_other_scenes_spoil_their_own_lidar_only() -> None:
    scenes, truth = _capture(0, 1.0, ("top", "left", "right"))
    mixed = [
        {**scene, "right": other["right"]}
        for scene, other in zip(scenes, [*scenes[1:], scenes[0]], strict=True)
    ]
    result = calibrate_lidars(mixed, "top")
    left, right = result.extrinsics
    assert right.verdict in (Verdict.BAD, Verdict.AMBIGUOUS)
    assert left.verdict.exit_code == 0
    assert left.T_reference_sensor is not None
    motion = relative_motion(truth["left"], left.T_reference_sensor)
    assert np.linalg.norm(motion[3:]) < 0.01
    assert result.verdict.exit_code == 4


def _near_the_truth(scenes: Scenes, truth: dict[str, Matrix]) -> LidarCalibration:
    """Return the calibration by registrations that begin near the truth, without a search."""
    config, limits = LidarCalibrationConfig(), LidarLimits()
    prepared = prepare_scenes(scenes, "top", limits)
    views = [{name: view_of(cloud, config) for name, cloud in c.items()} for c in prepared.clouds]
    off = np.eye(4)
    off[:3, 3] = 0.02, -0.02, 0.01
    found = {}
    for a, b in combinations(truth, 2):
        guess = np.linalg.inv(truth[a]) @ truth[b] @ off
        pairs = [(view[a], view[b]) for view in views]
        found[a, b] = register_views(pairs, config, guess, local=True)
    others = tuple(name for name in truth if name != "top")
    return conclude(RigEvidence("top", others, prepared, found, {"top": np.eye(4)}, limits))


_MOUNTS = {
    "top": np.eye(4),
    "left": pose(0.1, 0.6, -0.4, -4, 20, 92),
    "right": pose(0.1, -0.6, -0.4, 4, 20, -92),
}


@pytest.mark.parametrize("streets", [12, pytest.param(30, marks=pytest.mark.slow)])
def test_the_spread_covers_the_error_over_many_streets(streets: int) -> None:
    in_sd, errors = [], []
    for seed in range(streets):
        rng, boxes = np.random.default_rng(seed), street(1000 + seed)
        beams = {"top": rays(24, 240), "left": rays(16, 200), "right": rays(16, 200)}
        scene = {name: scan(boxes, TOP @ T, beams[name], rng) for name, T in _MOUNTS.items()}
        for motion, sd in _errors(_near_the_truth([scene], _MOUNTS), _MOUNTS).values():
            in_sd.append(sd)
            errors.append(motion)
    found = np.array(errors)
    assert np.degrees(np.median(np.linalg.norm(found[:, :3], axis=1))) < 0.02
    # One sparse scan each; full ones are held to 2 mm above.
    assert np.median(np.linalg.norm(found[:, 3:], axis=1)) < 0.004
    pooled = np.sqrt(np.mean(np.square(in_sd)))
    assert 0.7 < pooled < 1.5


@pytest.mark.slow
def test_the_spread_of_four_lidars_covers_the_error_over_thirty_streets() -> None:
    in_sd = []
    for seed in range(30):
        scenes, truth = _capture(seed, 1.0, ("top", "left", "right", "front"))
        result = calibrate_lidars(scenes, "top")
        for e in result.extrinsics:
            motion = relative_motion(
                truth[e.sensor],
                e.T_reference_sensor if e.T_reference_sensor is not None else np.eye(4),
            )
            wrong = np.linalg.norm(motion[3:]) > 0.05 or np.linalg.norm(motion[:3]) > 0.01
            assert not (wrong and e.verdict.exit_code == 0), (seed, e.sensor)
        if result.verdict.exit_code == 0:
            in_sd += [sd for _, sd in _errors(result, truth).values()]
    assert len(in_sd) > 60
    assert 0.7 < np.sqrt(np.mean(np.square(in_sd))) < 1.5
