"""The sensors of an OpenLABEL file: streams, lenses, coordinate systems and their transforms.

Names follow the standard's schema. Where its reference toolkit (VCD 6) reads a lens by other names
than the schema, both are written.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from percept.core.errors import InputError
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import Drive, Keyframe, LabelledFrame

__all__ = ["SceneSensors"]

_Json = dict[str, Any]
_SCAN = "scan"


class SceneSensors:
    """What the frames of a file were taken with, and where each of that was.

    Args:
        drive: The drive that the keyframes are of.
        keyframes: They.

    Raises:
        InputError: If a camera has the name of another coordinate system or stream.
    """

    def __init__(self, drive: Drive, keyframes: Sequence[Keyframe]) -> None:
        self._drive = drive
        names = dict.fromkeys(frame.camera for one in keyframes for frame in one.frames)
        self._cameras = {name: drive.cameras.get(name) for name in names}
        self._with_scan = any(one.scan for one in keyframes)
        worlds = (one.T_world_base.target for one in keyframes if one.T_world_base)
        self._world = next(worlds, None)
        self._check_names()

    def coordinate_systems(self) -> _Json:
        """Return the tree: the frame that does not move, the vehicle in it, cameras on that."""
        base, world = self._drive.base_frame, self._world
        systems: _Json = {
            base: {"type": "local_cs", "parent": world or "", "children": list(self._cameras)}
        }
        if world is not None:
            systems[world] = {"type": "scene_cs", "parent": "", "children": [base]}
        for name, sensor in self._cameras.items():
            systems[name] = {"type": "sensor_cs", "parent": base, "children": []}
            if sensor is not None and sensor.T_base_sensor is not None:
                systems[name]["pose_wrt_parent"] = _matrix(sensor.T_base_sensor)
        return systems

    def streams(self) -> _Json:
        """Return the cameras with their lenses, and the scans of all LiDARs as one."""
        streams: _Json = {
            name: {
                "type": "camera",
                "description": "" if sensor is None else sensor.topic or "",
                "uri": "",
                "stream_properties": _lens(sensor),
            }
            for name, sensor in self._cameras.items()
        }
        if self._with_scan:
            about = f"in frame {self._drive.base_frame}: {', '.join(self._drive.lidars)}"
            streams[_SCAN] = {"type": "lidar", "description": about, "uri": ""}
        return streams

    def of_frame(self, keyframe: Keyframe) -> _Json:
        """Return the `frame_properties` of a keyframe: files, times and transforms."""
        streams = {
            # The lens is repeated: VCD takes what a frame says of a stream for all there is.
            frame.camera: _moment(frame.file, frame.stamp_ns, _lens(self._cameras[frame.camera]))
            for frame in keyframe.frames
        }
        if keyframe.scan is not None:
            streams[_SCAN] = _moment(keyframe.scan.file, keyframe.scan.stamp_ns, {})
        return {
            "timestamp": str(keyframe.stamp_ns),
            "keyframe": keyframe.keyframe,
            "streams": streams,
            "transforms": self._transforms(keyframe),
        }

    def _transforms(self, keyframe: Keyframe) -> _Json:
        poses = {frame.camera: self._camera_pose(frame) for frame in keyframe.frames}
        if keyframe.T_world_base is not None:
            poses[keyframe.T_world_base.target] = keyframe.T_world_base
        base = self._drive.base_frame
        return {
            f"{base}_to_{name}": {"src": base, "dst": name, "transform_src_to_dst": _matrix(pose)}
            for name, pose in poses.items()
            if pose is not None
        }

    def _camera_pose(self, frame: LabelledFrame) -> Transform | None:
        """Return `T_camera_base`, from the base frame at the keyframe's time into the camera.

        None where the place of the camera or what the vehicle drove in between is not known: the
        camera's place on the vehicle is all that the file says then.
        """
        sensor = self._cameras[frame.camera]
        if sensor is None or sensor.T_base_sensor is None or frame.vehicle_place is None:
            return None
        return sensor.T_base_sensor.inverse() @ frame.vehicle_place

    def _check_names(self) -> None:
        fixed = [self._drive.base_frame, self._world, _SCAN]
        names = [*fixed, *self._cameras]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise InputError(
                f"'{twice[0]}' names two coordinate systems or streams, and OpenLABEL knows them "
                "by name alone",
                where=self._drive.log,
                remedy="Give the camera another name in the rig file",
            )


def _lens(sensor: CameraSensor | None) -> _Json:
    if sensor is None:
        return {}
    fx, fy, cx, cy = sensor.K
    width, height = sensor.image_size
    size = {"width_px": width, "height_px": height}
    if sensor.model == "fisheye":
        # r = k1 a + k2 a^3 + ...: OpenCV's fisheye model is this with k1 = 1.
        coefficients = [1.0, *sensor.distortion]
        lens = {
            **size, "model": "kannala", "focal_length_x": fx, "focal_length_y": fy,
            "center_x_px": cx, "center_y_px": cy, "center_x": cx, "center_y": cy,
            "lens_coeffs": coefficients, "lens_coeffs_1xN": coefficients,
        }  # fmt: skip
        return {"intrinsics_fisheye": lens}
    coefficients = list(sensor.distortion)
    matrix = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    lens = {
        **size, "camera_matrix": matrix, "camera_matrix_3x4": matrix,
        "distortion_coeffs": coefficients, "distortion_coeffs_1xN": coefficients,
    }  # fmt: skip
    return {"intrinsics_pinhole": lens}


def _moment(file: str, stamp_ns: int, lens: _Json) -> _Json:
    return {
        "uri": f"../{file}",
        "stream_properties": {**lens, "sync": {"timestamp": str(stamp_ns)}},
    }


def _matrix(pose: Transform) -> _Json:
    return {"matrix4x4": pose.matrix.ravel().tolist()}
