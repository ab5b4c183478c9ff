"""The rig that a team starts from: drawn by hand, and wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform, rotation_from_rpy

__all__ = ["wrong_rig"]

_TURNED_LIDAR, _TURN_DEG = "lidar_left", 45.0
_ROTATION_DEG, _TRANSLATION_M = (2.0, 6.0), (0.05, 0.12)
_FOCAL_ERROR, _CENTRE_ERROR_PX = 0.03, 10.0


def wrong_rig(rig: Rig, reference: str, rng: np.random.Generator) -> Rig:
    """Return a rig whose places and intrinsics are wrong, but for the place of the reference.

    Rotations are off by 2 to 6 deg, that of the left LiDAR by 45 deg, translations by 5 to
    12 cm, focal lengths by 3 %, principal points by up to 10 px, and there is no distortion.
    """
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for name, sensor in rig.sensors.items():
        placed = sensor.T_base_sensor
        if placed is not None and name != reference:
            degrees = _TURN_DEG if name == _TURNED_LIDAR else float(rng.uniform(*_ROTATION_DEG))
            placed = _moved(placed, degrees, float(rng.uniform(*_TRANSLATION_M)), rng)
        if isinstance(sensor, CameraSensor):
            sensors[name] = replace(_blurred(sensor, rng), T_base_sensor=placed)
        else:
            sensors[name] = replace(sensor, T_base_sensor=placed)
    return Rig(rig.base_frame, sensors)


def _moved(placed: Transform, degrees: float, metres: float, rng: np.random.Generator) -> Transform:
    if degrees == _TURN_DEG:
        turn = rotation_from_rpy(0.0, float(np.radians(degrees)), 0.0)
    else:
        axis = np.radians(degrees) * _unit(rng)
        turn = rotation_from_rpy(*axis.tolist())
    matrix = placed.matrix.copy()
    matrix[:3, :3] = matrix[:3, :3] @ turn
    matrix[:3, 3] += metres * _unit(rng)
    return Transform(placed.target, placed.source, matrix)


def _blurred(camera: CameraSensor, rng: np.random.Generator) -> CameraSensor:
    fx, fy, cx, cy = camera.K
    scale = 1 + _FOCAL_ERROR * float(rng.choice([-1.0, 1.0]))
    dx, dy = rng.uniform(-_CENTRE_ERROR_PX, _CENTRE_ERROR_PX, 2).tolist()
    K = (scale * fx, scale * fy, cx + dx, cy + dy)
    return replace(camera, K=K, distortion=(0.0,) * len(camera.distortion))


def _unit(rng: np.random.Generator) -> NDArray[np.float64]:
    direction = rng.standard_normal(3)
    unit: NDArray[np.float64] = direction / np.linalg.norm(direction)
    return unit
