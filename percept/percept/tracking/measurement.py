"""Detections in the form in which they enter a step: in the inertial frame, words as classes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.cameras import Camera
from percept.core.transform import Transform
from percept.tracking.filter import wrap_angle

__all__ = ["ImageMeasurement", "Measurement", "ScanMeasurement", "moved_boxes", "order_of"]

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
    """

    stamp_ns: int
    sensor: str
    boxes_m: _F64
    variances_m2: _F64
    words: NDArray[np.int64]
    confidences: _F64


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


def moved_boxes(boxes_m: _F64, T_target_source: Transform) -> _F64:
    """Return boxes (N, 7) in another frame; what it is tilted by is not in the yaw."""
    moved = np.array(boxes_m, dtype=np.float64)
    moved[:, :3] = T_target_source.apply(boxes_m[:, :3])
    rotation = T_target_source.rotation
    moved[:, 6] = wrap_angle(boxes_m[:, 6] + np.arctan2(rotation[1, 0], rotation[0, 0]))
    return moved
