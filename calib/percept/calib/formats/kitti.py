"""KITTI calibration files, a folder CAMERA/LIDAR for each pair.

`calib.txt` is that of the object benchmark: `P2 * R0_rect * Tr_velo_to_cam` takes a point of the
LiDAR into the image (Geiger et al., devkit_object readme). `calib_velo_to_cam.txt` and
`calib_cam_to_cam.txt` are those of the raw data. KITTI's images are rectified: there is one
camera here, its rectification is the identity, and its image must be free of distortion.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from percept.calib.formats.models import brown_coefficients, camera_sensor
from percept.calib.formats.reading import number_list
from percept.calib.formats.wording import commented, file_names, transforms_in_words
from percept.core.errors import ConfigError, GeometryError, InputError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform

__all__ = ["README", "is_kitti", "kitti_rig", "write_kitti"]

README = "README.txt"
_F64 = NDArray[np.float64]
_BASE = "velodyne"
_ABOUT = (
    "One folder CAMERA/LIDAR for each pair. calib.txt is that of KITTI's object benchmark,",
    "calib_cam_to_cam.txt and calib_velo_to_cam.txt those of its raw data.",
    "point_image = P2 * R0_rect * Tr_velo_to_cam * point_lidar; KITTI's cam is the optical frame.",
    "P0, P1 and P3 repeat P2 and 00, 01 and 03 repeat 02: each folder has one camera.",
    "Tr_imu_to_velo takes points of the rig's base frame into the LiDAR.",
    "The images must be undistorted with their own camera matrix first, as cv2.undistort does.",
)


def write_kitti(rig: Rig, about: Sequence[str], notes: Counter[str]) -> dict[str, str]:
    """Return three files for each pair of a camera and a LiDAR, and a README.

    Args:
        rig: The rig.
        about: Lines that say where the numbers come from.
        notes: Gets a line for everything that is left out or does not fit.

    Raises:
        ConfigError: If there is no pair whose places are known.
    """
    names = file_names(rig.sensors)
    cameras = [c for c in rig.cameras().values() if _is_placed(c, notes)]
    lidars = [s for s in rig.lidars().values() if _is_placed(s, notes)]
    if not cameras or not lidars:
        raise ConfigError(
            "KITTI needs a camera and a LiDAR whose T_base_sensor is known",
            remedy="Calibrate them first: percept calib camera-lidar",
        )
    files = {README: commented([*_ABOUT, *about, *transforms_in_words(rig)], mark="")}
    for camera in cameras:
        if any(camera.distortion):
            notes[f"{camera.name}: KITTI's P2 has no distortion: undistort its images first"] += 1
        if any(camera.distortion) and brown_coefficients(camera) is None:
            notes[f"{camera.name}: D_02 cannot hold its {camera.model} model: zeros"] += 1
        for lidar in lidars:
            folder = f"{names[camera.name]}/{names[lidar.name]}"
            files |= {f"{folder}/{name}": text for name, text in _pair(camera, lidar)}
    return files


def _is_placed(sensor: LidarSensor | CameraSensor, notes: Counter[str]) -> bool:
    if sensor.T_base_sensor is None:
        notes[f"{sensor.name} has no T_base_sensor: left out"] += 1
    return sensor.T_base_sensor is not None


def _pair(camera: CameraSensor, lidar: LidarSensor) -> list[tuple[str, str]]:
    T_base_camera, T_base_lidar = camera.T_base_sensor, lidar.T_base_sensor
    if T_base_camera is None or T_base_lidar is None:
        return []
    T_camera_lidar = (T_base_camera.inverse() @ T_base_lidar).matrix
    K = camera.camera().K
    P = np.column_stack([K, np.zeros(3)])
    benchmark = {f"P{index}": P for index in range(4)}
    benchmark["R0_rect"] = np.eye(3)
    benchmark["Tr_velo_to_cam"] = T_camera_lidar[:3]
    benchmark["Tr_imu_to_velo"] = T_base_lidar.inverse().matrix[:3]
    velo = {"R": T_camera_lidar[:3, :3], "T": T_camera_lidar[:3, 3]}
    size = np.array(camera.image_size, dtype=np.float64)
    D = np.array(brown_coefficients(camera) or np.zeros(5))
    cam: dict[str, _F64] = {}
    for index in range(4):
        parts = {
            "S": size, "K": K, "D": D, "R": np.eye(3), "T": np.zeros(3), "S_rect": size,
            "R_rect": np.eye(3), "P_rect": P,
        }  # fmt: skip
        cam |= {f"{name}_{index:02d}": value for name, value in parts.items()}
    return [
        ("calib.txt", _text(benchmark)),
        ("calib_velo_to_cam.txt", _text(velo)),
        ("calib_cam_to_cam.txt", _text(cam)),
    ]


def _text(values: dict[str, _F64]) -> str:
    lines = (
        f"{name}: {' '.join(f'{number + 0.0:.12e}' for number in value.ravel())}"
        for name, value in values.items()
    )
    return "\n".join(lines) + "\n"


def is_kitti(text: str) -> bool:
    """Return whether a file is a calibration of the object or odometry benchmark."""
    return text.startswith("P0:") or "\nP2:" in text


def kitti_rig(text: str, path: Path, notes: Counter[str]) -> Rig:
    """Return the LiDAR and the cameras whose images lie beside, as the benchmark keeps them.

    The file says nothing of the image size: `../image_2/NAME.png` does, and `image_3` too.

    Raises:
        InputError: If numbers are missing, or no image is there.
    """
    values = _values(text, path)
    Tr = _rigid(values.get("Tr_velo_to_cam", values.get("Tr")), "Tr_velo_to_cam", path)
    R0 = np.eye(4)
    if "R0_rect" in values:
        R0[:3, :3] = np.array(number_list(values["R0_rect"], 9, "R0_rect", path)).reshape(3, 3)
    sensors: dict[str, LidarSensor | CameraSensor] = {
        _BASE: LidarSensor(_BASE, None, _BASE, Transform.identity(_BASE, _BASE))
    }
    for index in range(4):
        name = f"cam{index}"
        size = _size_beside(path, index)
        if size is None:
            notes[f"{name}: no image in image_{index} says its size: left out"] += 1
        else:
            P = np.array(number_list(values.get(f"P{index}"), 12, f"P{index}", path)).reshape(3, 4)
            sensors[name] = _camera(name, P, R0 @ Tr, size, path)
    if len(sensors) == 1:
        raise InputError(
            "says no image size, and no image lies beside it",
            where=path,
            remedy="Keep the folders of the benchmark: calib/000000.txt and image_2/000000.png",
        )
    return Rig(_BASE, sensors)


def _camera(name: str, P: _F64, rect: _F64, size: tuple[int, int], path: Path) -> CameraSensor:
    """Return a rectified camera: P is K [I | t], t its shift from KITTI's cam 0."""
    K = P[:, :3]
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    shift = np.eye(4)
    shift[:3, 3] = np.linalg.solve(K, P[:, 3])
    try:
        T_camera_base = Transform(name, _BASE, _orthonormal(shift @ rect))
    except GeometryError as error:
        raise InputError("R0_rect * Tr_velo_to_cam is no rigid transform", where=path) from error
    model = ("pinhole", (0.0,) * 5)
    K4 = (float(fx), float(fy), float(cx), float(cy))
    return camera_sensor(name, size, K4, model, path, T_base_sensor=T_camera_base.inverse())


def _orthonormal(matrix: _F64) -> _F64:
    """Return a transform whose rotation, which the file has rounded, is exact."""
    turn, stretch, other = np.linalg.svd(matrix[:3, :3])
    if np.abs(stretch - 1).max() > 1e-3:
        raise GeometryError("it stretches")
    exact = matrix.copy()
    exact[:3, :3] = turn @ other
    return exact


def _rigid(value: object, what: str, path: Path) -> _F64:
    numbers = np.array(number_list(value, 12, what, path)).reshape(3, 4)
    return np.vstack([numbers, [0.0, 0.0, 0.0, 1.0]])


def _values(text: str, path: Path) -> dict[str, list[float]]:
    values = {}
    for line in text.splitlines():
        name, colon, rest = line.partition(":")
        if not colon:
            continue
        try:
            values[name.strip()] = [float(part) for part in rest.split()]
        except ValueError as error:
            raise InputError(f"'{name.strip()}' is no row of numbers", where=path) from error
    return values


def _size_beside(path: Path, index: int) -> tuple[int, int] | None:
    for suffix in (".png", ".jpg"):
        image = path.parent.parent / f"image_{index}" / f"{path.stem}{suffix}"
        pixels = cv2.imread(str(image)) if image.is_file() else None
        if pixels is not None:
            return pixels.shape[1], pixels.shape[0]
    return None
