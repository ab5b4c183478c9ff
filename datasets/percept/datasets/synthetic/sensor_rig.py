"""The vehicle that carries the sensors: four LiDARs, up to four cameras, GNSS and IMU."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from percept.core.clock import NS_PER_MS
from percept.core.errors import UsageError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform, rotation_from_rpy
from percept.datasets.synthetic.lidar import LidarModel

__all__ = [
    "BASE",
    "CAMERA_NAMES",
    "T_BASE_GNSS",
    "T_BASE_IMU",
    "make_cameras",
    "make_lidars",
    "make_rig",
]

BASE = "base_link"
CAMERA_NAMES = ("cam_front", "cam_left", "cam_right", "cam_rear")

_CAMERA_PLACES = {
    "cam_front": ((1.6, 0.0, 1.62), 0.0),
    "cam_left": ((1.2, 0.55, 1.65), 65.0),
    "cam_right": ((1.2, -0.55, 1.65), -65.0),
    "cam_rear": ((-0.4, 0.0, 1.65), 180.0),
}
_CAMERA_PITCH_DEG = 2.0
_HORIZONTAL_FOV_DEG = 75.0
_DISTORTION = (-0.08, 0.03, 0.0004, -0.0003, 0.0)
_R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _placed(
    name: str, translation_m: tuple[float, float, float], rpy_deg: tuple[float, float, float]
) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*np.radians(rpy_deg))
    matrix[:3, 3] = translation_m
    return Transform(BASE, name, matrix)


T_BASE_GNSS = _placed("gnss", (0.3, 0.0, 1.7), (0.0, 0.0, 0.0))
T_BASE_IMU = _placed("imu", (0.4, 0.1, 0.6), (0.0, 0.0, 0.0))


def make_lidars(beam_share: float = 1.0) -> tuple[LidarModel, ...]:
    """Return the LiDARs: centre top, left, right, and front at the bottom.

    Args:
        beam_share: Share of the beams and firings that is kept, for small test drives.
    """

    def model(
        name: str,
        place: Transform,
        beams: int,
        span_deg: tuple[float, float],
        steps: int,
        **rest: float,
    ) -> LidarModel:
        count = max(round(beams * beam_share), 4)
        elevations = np.radians(np.linspace(*span_deg, count))
        phase_ns = round(rest.get("phase_ms", 0.0) * NS_PER_MS)
        fov = float(np.radians(rest.get("fov_deg", 360.0)))
        firings = max(round(steps * beam_share), 64)
        return LidarModel(name, place, elevations, firings, fov, phase_ns)

    top = _placed("lidar_top", (1.1, 0.0, 1.95), (0.0, 0.0, 0.0))
    left = _placed("lidar_left", (1.0, 0.72, 1.72), (-18.0, 4.0, 35.0))
    right = _placed("lidar_right", (1.0, -0.72, 1.72), (18.0, 4.0, -35.0))
    front = _placed("lidar_front", (3.7, 0.0, 0.62), (0.0, -1.0, 0.0))
    return (
        model("lidar_top", top, 64, (-25.0, 3.0), 1024),
        model("lidar_left", left, 32, (-25.0, 15.0), 720, phase_ms=5),
        model("lidar_right", right, 32, (-25.0, 15.0), 720, phase_ms=10),
        model("lidar_front", front, 32, (-16.0, 15.0), 1200, phase_ms=15, fov_deg=200),
    )


def make_cameras(names: Collection[str], image_size: tuple[int, int]) -> tuple[CameraSensor, ...]:
    """Return cameras by name, in the order of `CAMERA_NAMES`.

    Raises:
        UsageError: If a name is not one of them.
    """
    unknown = sorted(set(names) - set(CAMERA_NAMES))
    if unknown:
        raise UsageError(
            f"no such camera '{unknown[0]}'", remedy=f"Choose from {', '.join(CAMERA_NAMES)}"
        )
    width, height = image_size
    focal = width / 2 / float(np.tan(np.radians(_HORIZONTAL_FOV_DEG / 2)))
    cameras = []
    for name in CAMERA_NAMES:
        if name in names:
            translation, yaw_deg = _CAMERA_PLACES[name]
            matrix = _placed(name, translation, (0.0, _CAMERA_PITCH_DEG, yaw_deg)).matrix.copy()
            matrix[:3, :3] = matrix[:3, :3] @ _R_BODY_OPTICAL
            cameras.append(
                CameraSensor(
                    name,
                    f"/{name}/image_raw/compressed",
                    name,
                    image_size,
                    "pinhole",
                    (focal, focal, (width - 1) / 2, (height - 1) / 2),
                    _DISTORTION,
                    Transform(BASE, name, matrix),
                )
            )
    return tuple(cameras)


def make_rig(lidars: Collection[LidarModel], cameras: Collection[CameraSensor]) -> Rig:
    """Return the exact rig of these sensors."""
    sensors: dict[str, LidarSensor | CameraSensor] = {
        m.name: LidarSensor(m.name, f"/{m.name}/points", m.name, m.T_base_sensor) for m in lidars
    }
    sensors.update({camera.name: camera for camera in cameras})
    return Rig(BASE, sensors)
