"""Kinds of streams, by what their messages decode to."""

from __future__ import annotations

from percept.core.samples import (
    CameraImage,
    CameraInfo,
    GnssFix,
    ImuSample,
    OdometrySample,
    PointCloud,
    PoseSample,
    Sample,
    TransformSample,
)

__all__ = ["SENSOR_KINDS", "kind_of"]

_KINDS: dict[type[Sample], str] = {
    PointCloud: "lidar",
    CameraImage: "camera",
    CameraInfo: "camera_info",
    ImuSample: "imu",
    GnssFix: "gnss",
    OdometrySample: "odometry",
    PoseSample: "pose",
    TransformSample: "tf",
}

SENSOR_KINDS = frozenset({"lidar", "camera", "imu", "gnss", "odometry", "pose"})
"""Kinds of streams that have a rhythm, and that the verdict therefore looks at."""


def kind_of(sample_type: type[Sample]) -> str:
    """Return the kind of stream whose messages decode to a sample type."""
    return _KINDS.get(sample_type, "other")
