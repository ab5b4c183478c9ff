"""Detections in the form in which they enter a step: in the inertial frame, words as classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.results import Detections3D
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.tracking.filter import wrap_angle

__all__ = ["ImageMeasurement", "Measurement", "ScanMeasurement", "order_of", "placed_boxes"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ScanMeasurement:
    """The boxes of one scan.

    Attributes:
        stamp_ns: Time of the scan.
        sensor: Name of the sensor.
        boxes_m: (N, 7) float64 in the inertial frame.
        variances_m2: (N, 3) float64 variances of their centres.
        words: (N,) int64 index of the class that each detection was said to be.
        confidences: (N,) float64 as the detector gave them.
        offsets_s: (N,) float64 when each box was measured, counted from `stamp_ns`.
    """

    stamp_ns: int
    sensor: str
    boxes_m: _F64
    variances_m2: _F64
    words: NDArray[np.int64]
    confidences: _F64
    offsets_s: _F64


@dataclass(frozen=True, slots=True, eq=False)
class ImageMeasurement:
    """The boxes of one image, of which only the class is used.

    Attributes:
        stamp_ns: Time of the image.
        sensor: Name of the camera.
        boxes_px: (N, 4) float64 x1, y1, x2, y2.
        words: (N,) int64 index of each class.
        confidences: (N,) float64.
        camera: The camera's model.
        T_camera_inertial: Where it was.
    """

    stamp_ns: int
    sensor: str
    boxes_px: _F64
    words: NDArray[np.int64]
    confidences: _F64
    camera: Camera
    T_camera_inertial: Transform


Measurement = ScanMeasurement | ImageMeasurement


def order_of(measurement: Measurement) -> tuple[int, int, str, bytes]:
    """Return the place of a measurement in time.

    Measurements of one moment are ordered by what they are, scans before images, then by the
    name of the sensor, then by what they hold: never by when they arrived.
    """
    if isinstance(measurement, ScanMeasurement):
        kind, boxes = 0, measurement.boxes_m
    else:
        kind, boxes = 1, measurement.boxes_px
    content = boxes.tobytes() + measurement.words.tobytes() + measurement.confidences.tobytes()
    return measurement.stamp_ns, kind, measurement.sensor, content


def placed_boxes(detections: Detections3D, poses: Trajectory) -> _F64 | None:
    """Return boxes (N, 7) in the frame that poses are given in, or None without a pose.

    Each is placed by the pose of the moment at which it was measured: a LiDAR that turns sees
    the objects of a scan one after another, and the vehicle goes on meanwhile. What the frame
    is tilted by is not in the yaw.
    """
    pose = poses.at(detections.stamp_ns)
    if pose is None:
        return None
    matrices, valid = poses.poses_at(detections.stamp_ns + detections.offsets_ns)
    matrices[~valid] = pose.matrix
    placed = np.array(detections.boxes_m, dtype=np.float64)
    placed[:, :3] = np.einsum("nij,nj->ni", matrices[:, :3, :3], detections.boxes_m[:, :3])
    placed[:, :3] += matrices[:, :3, 3]
    placed[:, 6] = wrap_angle(placed[:, 6] + np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0]))
    return placed
