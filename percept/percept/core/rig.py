"""The rig: which sensors a vehicle has, where they sit, and what their intrinsics are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field

from percept.core.cameras import Camera, PinholeCamera, make_camera
from percept.core.errors import ConfigError
from percept.core.settings import Settings, load_yaml_mapping, parse_settings
from percept.core.transform import Transform, quat_xyzw_from_matrix

__all__ = [
    "CameraSensor",
    "LidarSensor",
    "Rig",
    "load_rig",
    "parse_rig",
    "rig_as_mapping",
    "rig_as_yaml",
]

_Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
_Vector4 = Annotated[list[float], Field(min_length=4, max_length=4)]


class _PoseEntry(Settings):
    translation_m: _Vector3
    quat_xyzw: _Vector4


class _LidarEntry(Settings):
    kind: Literal["lidar"]
    topic: str | None = None
    frame: str
    T_base_sensor: _PoseEntry | None = None


class _CameraEntry(Settings):
    kind: Literal["camera"]
    topic: str | None = None
    frame: str
    image_size: Annotated[list[int], Field(min_length=2, max_length=2)]
    model: Literal["pinhole", "rational", "fisheye"]
    K: _Vector4
    distortion: list[float]
    T_base_sensor: _PoseEntry | None = None


class _RigFile(Settings):
    base_frame: str = "base_link"
    sensors: dict[str, Annotated[_LidarEntry | _CameraEntry, Field(discriminator="kind")]]


@dataclass(frozen=True, slots=True, eq=False)
class LidarSensor:
    """A LiDAR: its name, topic and frame, and `T_base_sensor` where it is known."""

    name: str
    topic: str | None
    frame: str
    T_base_sensor: Transform | None


@dataclass(frozen=True, slots=True, eq=False)
class CameraSensor:
    """A camera: its name, topic and optical frame, intrinsics, and `T_base_sensor` if known.

    Attributes:
        model: `pinhole` (5 coefficients), `rational` (8) or `fisheye` (4), as in OpenCV.
        K: fx, fy, cx, cy in pixels.
        distortion: Coefficients in OpenCV's order.
    """

    name: str
    topic: str | None
    frame: str
    image_size: tuple[int, int]
    model: str
    K: tuple[float, float, float, float]
    distortion: tuple[float, ...]
    T_base_sensor: Transform | None

    def camera(self) -> Camera:
        """Return the camera model.

        Raises:
            ConfigError: If the model does not have so many coefficients.
            GeometryError: If the intrinsics make no camera.
        """
        fx, fy, cx, cy = self.K
        K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        return make_camera(self.model, self.image_size, K, self.distortion)

    def pinhole(self) -> PinholeCamera:
        """Return the camera model where it has to be a pinhole.

        Raises:
            ConfigError: If the camera is not a pinhole.
        """
        camera = self.camera()
        if not isinstance(camera, PinholeCamera):
            raise ConfigError(
                f"camera '{self.name}' is '{self.model}'; only 'pinhole' can be used here"
            )
        return camera


@dataclass(frozen=True, slots=True, eq=False)
class Rig:
    """All sensors of a vehicle, by name, and the frame that they are placed in."""

    base_frame: str
    sensors: dict[str, LidarSensor | CameraSensor]

    def lidars(self) -> dict[str, LidarSensor]:
        """Return the LiDARs by name, in the order of the file."""
        return {n: s for n, s in self.sensors.items() if isinstance(s, LidarSensor)}

    def cameras(self) -> dict[str, CameraSensor]:
        """Return the cameras by name, in the order of the file."""
        return {n: s for n, s in self.sensors.items() if isinstance(s, CameraSensor)}


def load_rig(path: Path) -> Rig:
    """Read a rig file.

    Raises:
        ConfigError: If the file is not YAML, or a key, value or transform is not valid.
    """
    return parse_rig(load_yaml_mapping(path), where=path)


def parse_rig(content: dict[str, Any], *, where: object) -> Rig:
    """Return the rig that a rig file's content says.

    Args:
        content: Keys and values of the file.
        where: Where they are from, for errors.

    Raises:
        ConfigError: If a key, value or transform is not valid.
    """
    entries = parse_settings(_RigFile, content, where=where)
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for name, entry in entries.sensors.items():
        placed = entry.T_base_sensor
        T_base_sensor = None
        if placed is not None:
            length = float(np.linalg.norm(placed.quat_xyzw))
            if not abs(length - 1) < 1e-3 or not np.isfinite(placed.translation_m).all():
                raise ConfigError(
                    f"T_base_sensor of '{name}' is no rigid transform (quaternion length "
                    f"{length:.4g}, expected 1)",
                    where=where,
                )
            T_base_sensor = Transform.from_quat_xyzw(
                entries.base_frame, entry.frame, placed.translation_m, placed.quat_xyzw
            )
        if isinstance(entry, _LidarEntry):
            sensors[name] = LidarSensor(name, entry.topic, entry.frame, T_base_sensor)
        else:
            sensors[name] = CameraSensor(
                name,
                entry.topic,
                entry.frame,
                (entry.image_size[0], entry.image_size[1]),
                entry.model,
                (entry.K[0], entry.K[1], entry.K[2], entry.K[3]),
                tuple(entry.distortion),
                T_base_sensor,
            )
    return Rig(entries.base_frame, sensors)


def rig_as_mapping(rig: Rig) -> dict[str, Any]:
    """Return the content of a rig file that `parse_rig` reads back to the same rig."""
    sensors = {name: _entry(sensor) for name, sensor in rig.sensors.items()}
    return {"base_frame": rig.base_frame, "sensors": sensors}


def rig_as_yaml(rig: Rig) -> str:
    """Return the text of a rig file that `load_rig` reads back to the same rig."""
    content = rig_as_mapping(rig)
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)
    return text


def _entry(sensor: LidarSensor | CameraSensor) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": "lidar" if isinstance(sensor, LidarSensor) else "camera"}
    if sensor.topic is not None:
        entry["topic"] = sensor.topic
    entry["frame"] = sensor.frame
    if isinstance(sensor, CameraSensor):
        entry["image_size"] = list(sensor.image_size)
        entry["model"] = sensor.model
        entry["K"] = [float(value) for value in sensor.K]
        entry["distortion"] = [float(value) for value in sensor.distortion]
    if sensor.T_base_sensor is not None:
        entry["T_base_sensor"] = {
            "translation_m": sensor.T_base_sensor.translation_m.tolist(),
            "quat_xyzw": quat_xyzw_from_matrix(sensor.T_base_sensor.rotation).tolist(),
        }
    return entry
