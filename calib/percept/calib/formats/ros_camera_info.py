"""ROS CameraInfo as YAML, as `camera_calibration` writes it and camera drivers read it.

Read in two spellings: that one (`camera_matrix: {data: [...]}`) and the flat one of the message
(`K: [...]`, `D: [...]`, or `k` and `d` as ROS 2 prints it). The source of the keys is
camera_calibration_parsers and sensor_msgs/CameraInfo.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from percept.calib.formats.models import camera_sensor, model_and_coefficients, ros_model
from percept.calib.formats.reading import camera_matrix, image_size, number_list
from percept.calib.formats.wording import commented, file_names
from percept.core.errors import ConfigError
from percept.core.rig import CameraSensor, Rig

__all__ = ["camera_info_sensor", "is_camera_info", "write_camera_infos"]

_IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]


def write_camera_infos(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return one file for each camera: all three models fit.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If the rig has no camera.
    """
    cameras = rig.cameras()
    if not cameras:
        raise ConfigError(
            "the rig has no camera, and CameraInfo holds nothing else",
            remedy="Use --format ros-tf for where LiDARs sit",
        )
    for name in rig.lidars():
        notes[f"{name} is a LiDAR, and CameraInfo holds cameras only: left out"] += 1
    names = file_names(cameras)
    return {f"{names[name]}.yaml": _text(camera, about) for name, camera in cameras.items()}


def _text(camera: CameraSensor, about: Sequence[str]) -> str:
    fx, fy, cx, cy = camera.K
    camera.camera()  # refuses what makes no camera
    coefficients = [float(value) for value in camera.camera().distortion]
    content = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": camera.name,
        "camera_matrix": _matrix(3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        "distortion_model": ros_model(camera.model),
        "distortion_coefficients": _matrix(1, len(coefficients), coefficients),
        "rectification_matrix": _matrix(3, 3, _IDENTITY),
        "projection_matrix": _matrix(
            3, 4, [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
        ),
    }
    told = [*about, f"optical frame: {camera.frame} (z forward, x right, y down)"]
    body: str = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)
    return commented(told) + body


def _matrix(rows: int, columns: int, data: Sequence[float]) -> dict[str, Any]:
    return {"rows": rows, "cols": columns, "data": [float(value) for value in data]}


def is_camera_info(values: Mapping[str, Any]) -> bool:
    """Return whether a file is a CameraInfo in one of its spellings."""
    keys = {key.lower() for key in values}
    return "camera_matrix" in keys or "k" in keys


def camera_info_sensor(values: Mapping[str, Any], path: Path, camera: str | None) -> CameraSensor:
    """Return the camera of a CameraInfo file, whose place it does not say.

    Args:
        values: Content of the file.
        path: The file, for its name and for errors.
        camera: How to name the camera; None takes the name in the file, or the file's own.

    Raises:
        InputError: If the numbers make no camera.
    """
    found = {key.lower(): value for key, value in values.items()}
    size = image_size(
        found.get("image_width", found.get("width")),
        found.get("image_height", found.get("height")),
        path,
    )
    K = camera_matrix(found.get("camera_matrix", found.get("k")), "camera_matrix", path)
    distortion = found.get("distortion_coefficients", found.get("d"))
    coefficients = number_list(distortion, None, "distortion_coefficients", path)
    model_name = str(found.get("distortion_model") or "plumb_bob")
    header = found.get("header")
    frame = header.get("frame_id") if isinstance(header, Mapping) else None
    name = camera or str(found.get("camera_name") or path.stem)
    model = model_and_coefficients(model_name, coefficients, path)
    return camera_sensor(name, size, K, model, path, frame=str(frame) if frame else None)
