"""Autoware's sensor kit: where each sensor sits, as x, y, z, roll, pitch and yaw.

`sensors_calibration.yaml` places the kit in the vehicle, `sensor_kit_calibration.yaml` the
sensors in the kit; both are parent: child: {x, y, z, roll, pitch, yaw}, metres and radians, with
the rotation Rz(yaw) Ry(pitch) Rx(roll) of URDF. Here the kit's frame is the rig's base frame.

A camera is given by its `camera_link` (x forward, y left, z up). Its optical frame (z forward, x
right, y down) follows in Autoware's own URDF with roll, pitch, yaw = -90, 0, -90 degrees.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from percept.calib.formats.frames import rig_of_frames
from percept.calib.formats.placement import placed_sensors
from percept.calib.formats.reading import number_list, read_text, yaml_mapping
from percept.calib.formats.wording import commented, rounded, transforms_in_words
from percept.core.errors import ConfigError, InputError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform, rotation_from_rpy, rpy_from_rotation

__all__ = ["FILES", "autoware_rig", "is_sensor_kit", "write_sensor_kit"]

FILES = ("sensor_kit_calibration.yaml", "sensors_calibration.yaml")
_KIT = "sensor_kit_base_link"
_BASE = "base_link"
_SIX = ("x", "y", "z", "roll", "pitch", "yaw")
_RPY_LINK_OPTICAL = (-np.pi / 2, 0.0, -np.pi / 2)
_ABOUT = (
    "roll, pitch, yaw in rad: R = Rz(yaw) Ry(pitch) Rx(roll); point_parent = T * point_child",
    "NAME/camera_link is x forward, y left, z up; its optical frame is z forward, x right, y down",
    "the kit has no place for intrinsics: export ros-camera-info too",
    "NAME_base_link of a LiDAR is the frame of its points here: where the sensor's own URDF has",
    "an offset between the two (velodyne's has one in z), take it off",
)


def write_sensor_kit(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return the two files, or the first alone where the rig does not know the vehicle's base.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If no sensor has a place, or two would have one name.
    """
    kit: dict[str, dict[str, float]] = {}
    for sensor, T_base_sensor in placed_sensors(rig, notes):
        name = _link(sensor)
        if name in kit:
            raise ConfigError(f"two sensors would be '{name}'", remedy="Rename one in the rig")
        placed = T_base_sensor
        if isinstance(sensor, CameraSensor):
            placed = T_base_sensor @ _optical(sensor.frame, name).inverse()
        kit[name] = _six(placed)
    told = [*about, *_ABOUT, f"{_KIT} is the rig's {rig.base_frame}"]
    files = {FILES[0]: commented([*told, *transforms_in_words(rig)]) + _yaml({_KIT: kit})}
    if rig.base_frame == _BASE:
        zero = {_BASE: {_KIT: dict.fromkeys(_SIX, 0.0)}}
        files[FILES[1]] = commented(told) + _yaml(zero)
    else:
        notes[f"nothing says where '{rig.base_frame}' sits in {_BASE}: no {FILES[1]}"] += 1
    return files


def _link(sensor: LidarSensor | CameraSensor) -> str:
    return (
        f"{sensor.name}/camera_link"
        if isinstance(sensor, CameraSensor)
        else (f"{sensor.name}_base_link")
    )


def _optical(frame: str, link: str) -> Transform:
    """Return `T_link_optical`."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_from_rpy(*_RPY_LINK_OPTICAL)
    return Transform(link, frame, matrix)


def _six(transform: Transform) -> dict[str, float]:
    values = [*transform.translation_m, *rpy_from_rotation(transform.rotation)]
    return dict(zip(_SIX, rounded(values), strict=True))


def _yaml(content: Mapping[str, Any]) -> str:
    text: str = yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=False)
    return text


def is_sensor_kit(values: Mapping[str, Any]) -> bool:
    """Return whether a file is parent: child: {x, y, z, roll, pitch, yaw}."""
    children = [child for below in values.values() if isinstance(below, Mapping)
                for child in below.values()]  # fmt: skip
    return bool(children) and all(
        isinstance(child, Mapping) and set(_SIX) <= set(child) for child in children
    )


def autoware_rig(values: Mapping[str, Any], path: Path, notes: Counter[str]) -> Rig:
    """Return the LiDARs of a sensor kit; cameras are left out, for it has no intrinsics.

    The other of the two files is used where it lies beside.

    Raises:
        InputError: If a number is missing, or the frames are no tree.
    """
    transforms = _transforms(values, path)
    other = path.with_name(FILES[1] if path.name == FILES[0] else FILES[0])
    if path.name in FILES and other.is_file():
        transforms += _transforms(yaml_mapping(read_text(other), other), other)
    rig = rig_of_frames(transforms, path, notes)
    sensors: dict[str, LidarSensor | CameraSensor] = {}
    for sensor in rig.lidars().values():
        name = sensor.name.removesuffix("_base_link") or sensor.name
        T_base_sensor = sensor.T_base_sensor
        if T_base_sensor is not None:
            placed = Transform(rig.base_frame, name, T_base_sensor.matrix)
            sensors[name] = LidarSensor(name, None, name, placed)
    return Rig(rig.base_frame, sensors)


def _transforms(values: Mapping[str, Any], path: Path) -> list[Transform]:
    transforms = []
    for parent, children in values.items():
        if not isinstance(children, Mapping):
            raise InputError(f"'{parent}' holds no sensors", where=path)
        for child, six in children.items():
            six = six if isinstance(six, Mapping) else {}
            numbers = number_list([six.get(key) for key in _SIX], 6, str(child), path)
            matrix = np.eye(4)
            matrix[:3, :3] = rotation_from_rpy(*numbers[3:])
            matrix[:3, 3] = numbers[:3]
            transforms.append(Transform(str(parent), str(child), matrix))
    return transforms
