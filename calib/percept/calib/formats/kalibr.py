"""Kalibr's camera chain: intrinsics, and each camera's place relative to the one before it.

`T_cn_cnm1` maps points of the camera before into this one, `T_cam_imu` points of the IMU into
the camera (https://github.com/ethz-asl/kalibr/wiki/yaml-formats).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from percept.calib.formats.models import (
    brown_coefficients,
    camera_sensor,
    model_and_coefficients,
)
from percept.calib.formats.reading import image_size, matrix, number_list
from percept.calib.formats.wording import commented, transforms_in_words
from percept.core.errors import ConfigError, InputError
from percept.core.rig import CameraSensor, Rig
from percept.core.transform import Transform

__all__ = ["FILES", "is_camchain", "kalibr_cameras", "kalibr_rig", "write_camchain"]

FILES = ("camchain.yaml",)
_IMU = "imu0"


def write_camchain(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return the chain of the cameras whose place is known, or of the only camera.

    Args:
        rig: The rig. With a base frame `imu0`, `T_cam_imu` is written too.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If no camera can be written.
    """
    chain = _chain(rig, notes)
    for name in rig.lidars():
        notes[f"{name} is a LiDAR, and a camera chain holds cameras only: left out"] += 1
    content: dict[str, Any] = {}
    told = list(about)
    T_base_before: Transform | None = None
    for index, (camera, entry) in enumerate(chain):
        T_base_camera = camera.T_base_sensor
        if T_base_camera is not None and T_base_before is not None:
            T_cn_cnm1 = T_base_camera.inverse() @ T_base_before
            entry["T_cn_cnm1"] = T_cn_cnm1.matrix.tolist()
            told.append(f"cam{index} T_cn_cnm1: point_cam{index} = T * point_cam{index - 1}")
        if T_base_camera is not None and rig.base_frame == _IMU:
            entry["T_cam_imu"] = T_base_camera.inverse().matrix.tolist()
        T_base_before = T_base_camera
        told.append(f"cam{index} is {camera.name}, frame {camera.frame}")
        content[f"cam{index}"] = entry
    text: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)
    return {FILES[0]: commented([*told, *transforms_in_words(rig)]) + text}


def _chain(rig: Rig, notes: Counter[str]) -> list[tuple[CameraSensor, dict[str, Any]]]:
    """Return the cameras that the format can hold, with what it says of each."""
    alone = len(rig.cameras()) == 1
    chain = []
    for name, camera in rig.cameras().items():
        entry = _entry(camera)
        if entry is None:
            notes[f"{name}: Kalibr has k1, k2, p1, p2 or equidistant only: left out"] += 1
        elif camera.T_base_sensor is None and not alone:
            notes[f"{name} has no T_base_sensor: left out"] += 1
        else:
            chain.append((camera, entry))
    if not chain:
        reasons = "; ".join(notes) or "the rig has no camera"
        raise ConfigError(
            f"no camera can be written for Kalibr ({reasons})",
            remedy="Use --format opencv or ros-camera-info, or calibrate with --model fisheye",
        )
    return chain


def _entry(camera: CameraSensor) -> dict[str, Any] | None:
    """Return what Kalibr says of a camera, or None where it has no such model."""
    if camera.model == "fisheye":
        model, coefficients = "equidistant", tuple(camera.camera().distortion.tolist())
    else:
        brown = brown_coefficients(camera)
        if brown is None or brown[4] != 0:
            return None
        model, coefficients = "radtan", brown[:4]
    entry: dict[str, Any] = {
        "camera_model": "pinhole",
        "intrinsics": [float(value) for value in camera.K],
        "distortion_model": model,
        "distortion_coeffs": [float(value) for value in coefficients],
        "resolution": list(camera.image_size),
        "rostopic": camera.topic or f"/{camera.name}/image_raw",
    }
    return entry


def is_camchain(values: Mapping[str, Any]) -> bool:
    """Return whether a file is a camera chain."""
    first = values.get("cam0")
    return isinstance(first, Mapping) and "intrinsics" in first


def kalibr_cameras(values: Mapping[str, Any], path: Path) -> dict[str, CameraSensor]:
    """Return the cameras `cam0`, `cam1`, ... of a chain, without their places.

    Raises:
        InputError: If a camera has another model, or numbers are missing.
    """
    cameras = {}
    for name in _names(values):
        entry = values[name]
        if not isinstance(entry, Mapping):
            raise InputError(f"'{name}' is no camera", where=path)
        if entry.get("camera_model", "pinhole") != "pinhole":
            raise InputError(
                f"percept has no camera model '{entry.get('camera_model')}'",
                where=path,
                remedy="Calibrate with Kalibr's pinhole-radtan or pinhole-equi",
            )
        fx, fy, cx, cy = number_list(entry.get("intrinsics"), 4, f"{name}.intrinsics", path)
        width, height = number_list(entry.get("resolution"), 2, f"{name}.resolution", path)
        given = number_list(entry.get("distortion_coeffs"), None, f"{name}.distortion_coeffs", path)
        model = model_and_coefficients(str(entry.get("distortion_model", "none")), given, path)
        topic = entry.get("rostopic")
        size = image_size(width, height, path)
        cameras[name] = camera_sensor(
            name, size, (fx, fy, cx, cy), model, path, topic=str(topic) if topic else None
        )
    return cameras


def kalibr_rig(values: Mapping[str, Any], path: Path) -> Rig:
    """Return a chain as a rig, placed in the IMU's frame where the file knows it, else in cam0's.

    Raises:
        InputError: If a camera has another model, or a transform is none.
    """
    cameras = kalibr_cameras(values, path)
    with_imu = "T_cam_imu" in values["cam0"]
    base = _IMU if with_imu else "cam0"
    placed: dict[str, CameraSensor] = {}
    T_base_before = Transform.identity(base, "cam0")
    for index, (name, camera) in enumerate(cameras.items()):
        entry = values[name]
        if with_imu and "T_cam_imu" in entry:
            T_cam_imu = Transform(name, base, matrix(entry["T_cam_imu"], "T_cam_imu", path))
            T_base_camera = T_cam_imu.inverse()
        elif index == 0:
            T_base_camera = T_base_before
        else:
            T_cn_cnm1 = matrix(entry.get("T_cn_cnm1"), f"{name}.T_cn_cnm1", path)
            T_base_camera = (
                T_base_before @ Transform(name, T_base_before.source, T_cn_cnm1).inverse()
            )
        placed[name] = _with_place(camera, T_base_camera)
        T_base_before = T_base_camera
    return Rig(base, dict(placed))


def _names(values: Mapping[str, Any]) -> list[str]:
    names: list[str] = []
    while f"cam{len(names)}" in values:
        names.append(f"cam{len(names)}")
    return names


def _with_place(camera: CameraSensor, T_base_camera: Transform) -> CameraSensor:
    return CameraSensor(
        camera.name, camera.topic, camera.frame, camera.image_size, camera.model, camera.K,
        camera.distortion, T_base_camera,
    )  # fmt: skip
