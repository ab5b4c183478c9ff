"""OpenCalib's JSON of a camera's intrinsics (PJLab-ADG/SensorsCalibration); read only."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from percept.calib.formats.models import camera_sensor, model_and_coefficients
from percept.calib.formats.reading import camera_matrix, image_size, number_list
from percept.core.errors import InputError
from percept.core.rig import CameraSensor

__all__ = ["opencalib_sensor"]


def opencalib_sensor(text: str, path: Path, camera: str | None) -> CameraSensor:
    """Return the camera of such a file.

    Args:
        text: Content of the file.
        path: The file, for its name and for errors.
        camera: How to name the camera; None takes the name in the file.

    Raises:
        InputError: If it is no such file, or the numbers make no camera.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON ({error})", where=path) from error
    entries = list(content.values()) if isinstance(content, dict) else []
    entry = entries[0] if entries and isinstance(entries[0], Mapping) else {}
    param = entry.get("param")
    if entry.get("param_type") != "intrinsic" or not isinstance(param, Mapping):
        raise InputError("holds no camera intrinsics that percept knows", where=path)
    size = image_size(param.get("img_dist_w"), param.get("img_dist_h"), path)
    K = camera_matrix(param.get("cam_K"), "cam_K", path)
    given = number_list(param.get("cam_dist"), None, "cam_dist", path)
    model = model_and_coefficients("plumb_bob", given, path)
    name = camera or str(entry.get("sensor_name") or path.stem)
    return camera_sensor(name, size, K, model, path)
