"""What lens a camera of a log has: from the rig, or from the `CameraInfo` beside its images."""

from __future__ import annotations

import re
from dataclasses import replace

from percept.calib.formats.models import camera_sensor, model_and_coefficients
from percept.core.cameras import Camera
from percept.core.errors import PerceptError
from percept.core.rig import CameraSensor
from percept.core.samples import CameraImage, CameraInfo
from percept.datasets.inspection.sensors import implausible_intrinsics, info_topic_of
from percept.datasets.recording import Recording

__all__ = ["log_intrinsics", "rig_intrinsics"]

_LARGEST_STRETCH = 0.01
_RECTIFIED = re.compile(r"(?:^|[_/])(?:rect|undistort)")

Size = tuple[int, int]


def rig_intrinsics(sensor: CameraSensor, image_size: Size | None) -> tuple[Camera | None, str]:
    """Return the camera of a rig for images of a size, or None, and a note, empty if all is well.

    Intrinsics for another size of the same shape are scaled.

    Args:
        sensor: The camera in the rig.
        image_size: (width, height) of the recorded images; None where no image can be read.

    Raises:
        PerceptError: If the numbers in the rig make no camera.
    """
    return _resized(sensor, image_size, "the rig's intrinsics")


def log_intrinsics(
    recording: Recording, image: CameraImage, image_size: Size
) -> tuple[Camera | None, str]:
    """Return the camera that the log's own `CameraInfo` describes, or None, and a note.

    The topic beside the images counts (`/cam/camera_info` with `/cam/image_raw`). What cannot be
    right is not used, and the note says why.

    Args:
        recording: The log.
        image: An image of the camera.
        image_size: (width, height) of the recorded images.
    """
    topics = [t.topic for t in recording.topics() if t.sample_type is CameraInfo and t.count]
    topic = info_topic_of(image.topic, topics)
    if topic is None:
        return None, "its intrinsics are not known: neither a rig nor the log has them"
    info = next(iter(recording.samples(topics=[topic])), None)
    if not isinstance(info, CameraInfo):
        return None, f"its intrinsics are not known: {topic} cannot be read"
    own_size = info.image_size if min(info.image_size) > 0 else image_size
    problem = implausible_intrinsics(replace(info, image_size=own_size), own_size)
    if problem is not None:
        return None, f"its intrinsics are not known: those in {topic} make no sense ({problem})"
    if _RECTIFIED.search(image.topic) and info.distortion.any():
        return None, (
            f"its intrinsics are not known: the images are rectified, and {topic} tells of those "
            "that are not"
        )
    try:
        sensor = _sensor_of(replace(info, image_size=own_size), recording)
    except PerceptError as error:
        return None, f"its intrinsics are not known: those in {topic} cannot be used ({error.what})"
    return _resized(sensor, image_size, f"the intrinsics in {topic}")


def _sensor_of(info: CameraInfo, recording: Recording) -> CameraSensor:
    path = recording.paths[0]
    model = model_and_coefficients(info.model, info.distortion.tolist(), path)
    K = (info.K[0, 0], info.K[1, 1], info.K[0, 2], info.K[1, 2])
    fx, fy, cx, cy = (float(value) for value in K)
    return camera_sensor("camera", info.image_size, (fx, fy, cx, cy), model, path)


def _resized(
    sensor: CameraSensor, image_size: Size | None, whose: str
) -> tuple[Camera | None, str]:
    if image_size is None or image_size == sensor.image_size:
        return sensor.camera(), ""
    sizes = f"{whose} are for {sensor.image_size[0]}x{sensor.image_size[1]} images"
    found = f"these have {image_size[0]}x{image_size[1]}"
    across, down = (new / old for new, old in zip(image_size, sensor.image_size, strict=True))
    if abs(across / down - 1) > _LARGEST_STRETCH:
        return None, f"its intrinsics are not known: {sizes}, {found}"
    fx, fy, cx, cy = sensor.K
    # Pixel (0, 0) is the centre of a pixel: the image begins half a pixel before it.
    K = (fx * across, fy * down, (cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5)
    return replace(sensor, image_size=image_size, K=K).camera(), f"{sizes}, {found}: scaled"
