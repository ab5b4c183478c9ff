"""Scans as rerun draws them: points, boxes and plots."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from percept.core.results import Detections3D
from percept.export.palette import class_colour, cluster_colours
from percept.export.view.motion import Motion
from percept.export.view.stream import Turns, ViewStream
from percept.lidar.result import ScanResult

__all__ = ["POINTS_PER_SCAN", "ScanDrawing"]

POINTS_PER_SCAN = 40_000

_BYTES_PER_POINT = 16  # three float32 and a colour
_GROUND_RGB: NDArray[np.uint8] = np.array((92, 84, 74), dtype=np.uint8)
_NAMELESS_RGB = (105, 110, 115)


class ScanDrawing:
    """Draws scans into a view.

    Args:
        stream: The view.
        motion: How the vehicle moves.
        turns: Which of them are drawn.
    """

    def __init__(self, stream: ViewStream, motion: Motion, turns: Turns) -> None:
        self._stream = stream
        self._motion = motion
        self._turns = turns
        self._labels: dict[str, set[str]] = {}
        self._boxes: dict[str, None] = {}

    @property
    def boxes(self) -> tuple[str, ...]:
        """Entities of the boxes that were drawn."""
        return (*self._boxes,)

    def add(self, result: ScanResult) -> None:
        """Plot a scan, and draw its points and boxes if it is its turn."""
        detections = result.detections
        labels = self._labels.setdefault(detections.sensor, set())
        labels.update(detections.labels)  # a class that was seen before and is not there now is 0
        counts = {name: detections.labels.count(name) for name in sorted(labels)}
        colours = {name: class_colour(name) for name in counts}
        self._stream.plot("objects", detections.sensor, counts, colours)
        self._stream.plot("milliseconds", detections.sensor, result.timings_ms)
        drawn_bytes = min(len(result.cloud), POINTS_PER_SCAN) * _BYTES_PER_POINT
        if self._turns.take(detections.sensor, drawn_bytes):
            place = self._stream.entity_in(detections.frame_id, detections.sensor)
            self._motion.place(place, detections.frame_id, detections.stamp_ns)
            self._stream.log(f"{place}/cloud", _points(result))
            for part, known in (("boxes", True), ("unknown", False)):
                self._stream.log(f"{place}/{part}", _boxes(detections, known=known))
                self._boxes[f"{place}/{part}"] = None


def _points(result: ScanResult) -> rr.Points3D:
    """Return at most `POINTS_PER_SCAN` points: ground brown, clusters in hues, the rest grey."""
    step = max(1, math.ceil(len(result.cloud) / POINTS_PER_SCAN))
    colours = cluster_colours(result.cluster_ids[::step])
    colours = np.where(result.ground[::step, None], _GROUND_RGB, colours)
    return rr.Points3D(
        result.cloud.points_xyz[::step], colors=colours, radii=rr.Radius.ui_points(1.5)
    )


def _boxes(detections: Detections3D, *, known: bool) -> rr.Boxes3D:
    """Return the boxes with a class, or those without one: thin and nameless, for a clear view."""
    rows = [row for row, label in enumerate(detections.labels) if (label != "unknown") == known]
    boxes_m = detections.boxes_m[rows]
    labels = [detections.labels[row] for row in rows]
    confidences = detections.confidences[rows]
    return rr.Boxes3D(
        centers=boxes_m[:, :3],
        sizes=boxes_m[:, 3:6],
        quaternions=_quat_xyzw_of_yaw(boxes_m[:, 6]),
        colors=[class_colour(label) if known else _NAMELESS_RGB for label in labels],
        radii=rr.Radius.ui_points(1.5 if known else 0.5),
        fill_mode=rr.components.FillMode.MajorWireframe,
        labels=[f"{label} {score:.2f}" for label, score in zip(labels, confidences, strict=True)],
        show_labels=known,
    )


def _quat_xyzw_of_yaw(yaw_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions (N, 4) of turns about z."""
    zero = np.zeros_like(yaw_rad)
    return np.column_stack([zero, zero, np.sin(yaw_rad / 2), np.cos(yaw_rad / 2)])
