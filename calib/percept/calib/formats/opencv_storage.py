"""OpenCV's FileStorage: intrinsics of each camera, and all transforms in a file of their own."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.calib.formats.models import camera_sensor, model_and_coefficients, ros_model
from percept.calib.formats.reading import (
    camera_matrix,
    image_size,
    number_list,
    yaml_mapping,
)
from percept.calib.formats.wording import commented, file_names, transforms_in_words
from percept.core.errors import ConfigError
from percept.core.rig import CameraSensor, Rig
from percept.core.transform import Transform

__all__ = ["FILES", "is_opencv", "opencv_sensor", "write_opencv"]

FILES = ("extrinsics.yml",)
_HEAD = "%YAML:1.0\n---\n"


def write_opencv(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return `NAME.yml` for each camera, and `extrinsics.yml` with all known transforms.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out.

    Raises:
        ConfigError: If the rig has neither cameras nor known transforms.
    """
    names = file_names(["extrinsics", *rig.cameras()])
    files = {f"{names[n]}.yml": _camera_text(c, about) for n, c in rig.cameras().items()}
    transforms = [s.T_base_sensor for s in rig.sensors.values() if s.T_base_sensor is not None]
    for name, sensor in rig.sensors.items():
        if sensor.T_base_sensor is None:
            notes[f"{name} has no T_base_sensor: not in {FILES[0]}"] += 1
    if transforms:
        told = commented([*about, *transforms_in_words(rig)])
        files[FILES[0]] = _HEAD + told + "transforms:\n" + "".join(map(_transform, transforms))
    if not files:
        raise ConfigError("the rig has neither cameras nor known transforms")
    return files


def _camera_text(camera: CameraSensor, about: Sequence[str]) -> str:
    model = camera.camera()
    fisheye = int(camera.model == "fisheye")
    return (
        f"{_HEAD}{commented([*about, f'optical frame: {camera.frame}'])}"
        f"camera_name: {_string(camera.name)}\n"
        f"image_width: {camera.image_size[0]}\n"
        f"image_height: {camera.image_size[1]}\n"
        f"distortion_model: {_string(ros_model(camera.model))}\n"
        f"fisheye_model: {fisheye}\n"
        f"camera_matrix: {_matrix(model.K)}"
        f"distortion_coefficients: {_matrix(model.distortion[:, None])}"
    )


def _transform(T_base_sensor: Transform) -> str:
    """Return both directions of a transform as an entry of a list."""
    target, source = _string(T_base_sensor.target), _string(T_base_sensor.source)
    inverse = T_base_sensor.inverse().matrix
    return (
        f"  -\n    parent: {target}\n    child: {source}\n"
        f"    T_parent_child: {_matrix(T_base_sensor.matrix, indent=7)}"
        f"    T_child_parent: {_matrix(inverse, indent=7)}"
    )


def _matrix(values: NDArray[np.float64], indent: int = 3) -> str:
    pad = " " * indent
    data = ", ".join(repr(float(value)) for value in values.ravel())
    rows, columns = values.shape
    return (
        f"!!opencv-matrix\n{pad}rows: {rows}\n{pad}cols: {columns}\n{pad}dt: d\n"
        f"{pad}data: [ {data} ]\n"
    )


def _string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def is_opencv(text: str) -> bool:
    """Return whether a text is YAML of OpenCV's FileStorage."""
    return text.startswith("%YAML:1.0") or "!!opencv-matrix" in text


def opencv_sensor(text: str, path: Path, camera: str | None) -> CameraSensor:
    """Return the camera of a FileStorage, as percept and OpenCV's own sample write it.

    Args:
        text: Content of the file.
        path: The file, for its name and for errors.
        camera: How to name the camera; None takes the name in the file, or the file's own.

    Raises:
        InputError: If it cannot be read, or the numbers make no camera.
    """
    # Not with OpenCV's own reader: a damaged file makes it write over memory that is not its own.
    plain = re.sub(r"\A%YAML\S*[^\n]*\n", "", text).replace("!!opencv-matrix", "")
    values = yaml_mapping(plain, path)
    fisheye = values.get("fisheye_model") == 1 or values.get("distortion_model") == "equidistant"
    K = camera_matrix(values.get("camera_matrix"), "camera_matrix", path)
    size = image_size(values.get("image_width"), values.get("image_height"), path)
    what = "distortion_coefficients"
    given = number_list(values.get(what), None, what, path)
    model = model_and_coefficients("equidistant" if fisheye else "plumb_bob", given, path)
    name = camera or str(values.get("camera_name") or path.stem)
    return camera_sensor(name, size, K, model, path)
