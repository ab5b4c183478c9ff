"""The images of a keyframe as formats without a lens model see them.

A scan and its 3D boxes are where things were at the keyframe's time; an image is taken a little
before or after. A view joins both: its transform has what the vehicle drove in between, so that
points and boxes of the scan land where they are in the image. What objects drove in between is
not in it: a 3D box stays on its points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.formats.solid_needs import placed_camera
from percept.datasets.labelling.images.rectify import LEAST_SHOWN, rectified_boxes, rectified_camera
from percept.datasets.labelling.labelled_set import (
    ImageBoxes,
    Keyframe,
    LabelledFrame,
    LabelledSet,
)

__all__ = ["CameraView", "camera_views", "rectified_labels"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CameraView:
    """One image of a keyframe, without distortion.

    Attributes:
        frame: The image.
        sensor: Its rectified camera.
        T_base_camera: Where it sits in the vehicle.
        T_then_base: From the base frame at the keyframe's time into that at the image's.
        T_camera_base: From the base frame at the keyframe's time into the camera at the image's.
        moved: Whether what the vehicle drove in between is known; if not it counts as standing.
        boxes: Its boxes in the rectified image; `truncated` has what rectifying cut off.
        left_out: Number of boxes that the rectified image does not show.
    """

    frame: LabelledFrame
    sensor: CameraSensor
    T_base_camera: Transform
    T_then_base: Transform
    T_camera_base: Transform
    moved: bool
    boxes: ImageBoxes
    left_out: int


def camera_views(labelled: LabelledSet, keyframe: Keyframe) -> Iterator[CameraView]:
    """Yield the images of a keyframe.

    Raises:
        InputError: If the lens or the place of a camera is not known.
    """
    for frame in keyframe.frames:
        sensor, T_base_camera = placed_camera(labelled, keyframe, frame)
        base = T_base_camera.target
        T_then_base = frame.vehicle_place or Transform.identity(base, base)
        boxes, kept = rectified_labels(frame.boxes, sensor)
        yield CameraView(
            frame=frame,
            sensor=rectified_camera(sensor),
            T_base_camera=T_base_camera,
            T_then_base=T_then_base,
            T_camera_base=T_base_camera.inverse() @ T_then_base,
            moved=frame.vehicle_place is not None or frame.offset_ns == 0,
            boxes=boxes,
            left_out=len(frame.boxes) - int(kept.sum()),
        )


def rectified_labels(
    boxes: ImageBoxes, sensor: CameraSensor
) -> tuple[ImageBoxes, NDArray[np.bool_]]:
    """Return the boxes of a recorded image in the rectified one.

    Args:
        boxes: Boxes of the recorded image.
        sensor: The camera that took it.

    Returns:
        Those of which the rectified image shows enough, and the mask (N,) of them. Where part of
        a box is cut off `truncated` says so; where it was not known it tells that part alone.
    """
    moved, shown = rectified_boxes(boxes.boxes_px, sensor)
    kept = shown >= LEAST_SHOWN
    before = np.where((shown < 1) & np.isnan(boxes.truncated), 0.0, boxes.truncated)
    rows = np.flatnonzero(kept)
    rectified = replace(
        boxes,
        ids=boxes.ids[rows],
        boxes_px=moved[rows],
        labels=tuple(boxes.labels[row] for row in rows),
        confidences=boxes.confidences[rows],
        sources=tuple(boxes.sources[row] for row in rows),
        track_ids=boxes.track_ids[rows],
        solids=boxes.solids[rows],
        truncated=(1 - (1 - before) * shown)[rows],
        occluded=boxes.occluded[rows],
    )
    return rectified, kept
