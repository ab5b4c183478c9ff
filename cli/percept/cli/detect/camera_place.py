"""Where a camera is among the sensors that measure distance."""

from __future__ import annotations

from percept.cli.detect.lidar_part import LidarPart
from percept.core.transform import Transform
from percept.datasets.cameras import CameraStream
from percept.detection.space.placing import CameraPlace

__all__ = ["camera_place"]


def camera_place(camera: CameraStream, lidars: LidarPart | None) -> CameraPlace | None:
    """Return where a camera is among the LiDARs, and where its depth images give places.

    Scans of LiDARs whose places are not known are in frames of their own: the first frame counts.
    Depth images give places in the clouds' frame, else in the camera's base, else in its own.

    Args:
        camera: The camera.
        lidars: The LiDAR half, or None.

    Returns:
        None where neither scans nor depth images can tell where its boxes are.
    """
    if camera.camera is None:
        return None
    T_camera_clouds = _among_clouds(camera, lidars) if lidars is not None else {}
    first = next(iter(T_camera_clouds.values()), None)
    T_target_camera = None
    if camera.depth_topic is not None:
        own = camera.T_base_sensor or Transform.identity(camera.frame, camera.frame)
        T_target_camera = own if first is None else first.inverse()
    if first is None and T_target_camera is None:
        return None
    return CameraPlace(
        camera=camera.camera, T_camera_clouds=T_camera_clouds, T_target_camera=T_target_camera
    )


def _among_clouds(camera: CameraStream, lidars: LidarPart) -> dict[str, Transform]:
    found = {s: camera.place_of(lidars.streams.sensor_of(s)) for s in lidars.detectors}
    known = {stream: T for stream, T in found.items() if T is not None}
    frame = next((T.source for T in known.values()), None)
    return {stream: T for stream, T in known.items() if T.source == frame}
