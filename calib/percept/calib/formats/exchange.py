"""A rig in the files of other tools, and back: the one place that knows all formats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from percept.calib.formats import autoware, kalibr, kitti, opencv_storage, ros_tf, urdf
from percept.calib.formats.opencalib import opencalib_sensor
from percept.calib.formats.reading import read_text, yaml_mapping
from percept.calib.formats.ros_camera_info import (
    camera_info_sensor,
    is_camera_info,
    write_camera_infos,
)
from percept.calib.formats.wording import commented, transforms_in_words
from percept.core.errors import InputError, UsageError
from percept.core.rig import CameraSensor, Rig, load_rig, rig_as_yaml

__all__ = ["FIXED_FILES", "FORMATS", "export_rig", "import_rig", "read_intrinsics"]

_Writer = Callable[[Rig, Sequence[str], Counter[str]], dict[str, str]]

_RIG_FILE = "rig.yaml"
_BASE = "base_link"


def _write_rig(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    del notes  # nothing is lost
    return {_RIG_FILE: commented([*about, *transforms_in_words(rig)]) + rig_as_yaml(rig)}


FORMATS: dict[str, _Writer] = {
    "ros-camera-info": write_camera_infos,
    "ros-tf": ros_tf.write_static_transforms,
    "urdf": urdf.write_urdf,
    "kalibr": kalibr.write_camchain,
    "kitti": kitti.write_kitti,
    "opencv": opencv_storage.write_opencv,
    "autoware": autoware.write_sensor_kit,
    "rig": _write_rig,
}
"""How each format is written."""

FIXED_FILES = (
    *ros_tf.FILES, *urdf.FILES, *kalibr.FILES, *opencv_storage.FILES, *autoware.FILES,
    kitti.README, _RIG_FILE,
)  # fmt: skip
"""Names of files that do not depend on the names of sensors."""


def export_rig(
    rig: Rig,
    format: str,  # noqa: A002 - the word that the command line and the docs have for it
    *,
    about: Sequence[str] = (),
    notes: Counter[str] | None = None,
) -> dict[str, str]:
    """Return a rig as the files of another tool.

    Args:
        rig: The rig.
        format: One of `FORMATS`.
        about: Lines that say where the numbers come from; they become comments.
        notes: Gets a line for everything that the format cannot hold.

    Returns:
        Text of each file, by its name relative to a folder; always the same for the same rig.

    Raises:
        UsageError: If there is no such format.
        ConfigError: If the format can hold nothing of the rig.
    """
    if format not in FORMATS:
        raise UsageError(f"no format '{format}'", remedy=f"Choose from {', '.join(FORMATS)}")
    return FORMATS[format](rig, about, Counter() if notes is None else notes)


def import_rig(path: Path, notes: Counter[str] | None = None) -> Rig:
    """Read a rig from a file of any tool that percept knows, or the folder of a calibration run.

    A rig.yaml, the YAML of `ros-tf`, URDF, Kalibr camera chains, calibrations of KITTI's
    benchmarks, Autoware's sensor kit; a file of intrinsics gives a rig of one camera without a
    place.

    Args:
        path: The file.
        notes: Gets a line for everything that could not be taken over.

    Raises:
        InputError: If the file is none of these, or holds nothing that can be used.
        ConfigError: If a rig.yaml is not valid.
    """
    path = _rig_in(path) if path.is_dir() else path
    text = read_text(path)
    notes = Counter() if notes is None else notes
    if text.lstrip().startswith("<"):
        return urdf.urdf_rig(text, path, notes)
    if kitti.is_kitti(text):
        return kitti.kitti_rig(text, path, notes)
    if path.suffix != ".json" and not opencv_storage.is_opencv(text):
        values = yaml_mapping(text, path)
        if "sensors" in values:
            return load_rig(path)
        if ros_tf.is_static_transforms(values):
            return ros_tf.static_transforms_rig(values, path, notes)
        if kalibr.is_camchain(values):
            return kalibr.kalibr_rig(values, path)
        if autoware.is_sensor_kit(values):
            return autoware.autoware_rig(values, path, notes)
    camera = read_intrinsics(path)
    notes[f"{camera.name}: the file does not say where it sits"] += 1
    return Rig(_BASE, {camera.name: camera})


def read_intrinsics(path: Path, camera: str | None = None) -> CameraSensor:
    """Read the intrinsics of a camera from a file of any tool that percept knows.

    A rig.yaml, ROS CameraInfo in its spellings, OpenCV's FileStorage, Kalibr camera chains, and
    OpenCalib's JSON.

    Args:
        path: The file.
        camera: Which camera, where the file has several; otherwise what to call it.

    Raises:
        InputError: If the file is none of these, or has several cameras and none is chosen.
        ConfigError: If a rig.yaml is not valid.
    """
    text = read_text(path)
    if opencv_storage.is_opencv(text):
        return opencv_storage.opencv_sensor(text, path, camera)
    if path.suffix == ".json":
        return opencalib_sensor(text, path, camera)
    values = yaml_mapping(text, path)
    if "sensors" in values:
        return _chosen(load_rig(path).cameras(), camera, path)
    if kalibr.is_camchain(values):
        return _chosen(kalibr.kalibr_cameras(values, path), camera, path)
    if is_camera_info(values):
        return camera_info_sensor(values, path, camera)
    raise InputError(
        "holds no camera intrinsics that percept knows",
        where=path,
        remedy="Give a rig.yaml, ROS CameraInfo, OpenCV, Kalibr or OpenCalib file",
    )


def _chosen(cameras: dict[str, Any], camera: str | None, path: Path) -> CameraSensor:
    known = ", ".join(cameras) or "none"
    if camera is None and len(cameras) != 1:
        raise InputError(f"has {len(cameras)} cameras ({known})", where=path, remedy="Choose one")
    if camera is not None and camera not in cameras:
        raise InputError(f"has no camera '{camera}' (it has: {known})", where=path)
    found: CameraSensor = cameras[camera or next(iter(cameras))]
    return found


def _rig_in(folder: Path) -> Path:
    found = folder / _RIG_FILE
    if not found.is_file():
        raise InputError(
            "has no rig.yaml",
            where=folder,
            remedy="A calibration run writes one when its verdict is good or doubtful",
        )
    return found
