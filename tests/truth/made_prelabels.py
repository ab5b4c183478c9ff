"""Boxes of networks in an image of a camera that looks ahead, and 3D boxes before it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from percept.core.results import Detections2D
from percept.core.rig import CameraSensor
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labelling.prelabels.label_keyframe import ImageView

__all__ = ["AHEAD", "CAR_M", "CAR_PX", "net", "solids", "view"]

_LOOKING_AHEAD = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
AHEAD = CameraSensor(
    "front", None, "front", (200, 100), "pinhole", (100, 100, 99.5, 49.5), (0.0,),
    Transform("base", "front", _LOOKING_AHEAD),
)  # fmt: skip
CAR_PX = (90.0, 45.0, 110.0, 55.0)
CAR_M = (11.0, 0.0, 0.0, 2.0, 2.0, 1.0, 0.0)
Box = tuple[str, float, Sequence[float]]


def net(*boxes: Box) -> Detections2D:
    return Detections2D(
        0,
        "front",
        np.array([box for _, _, box in boxes], dtype=np.float64).reshape(-1, 4),
        tuple(label for label, _, _ in boxes),
        np.array([confidence for _, confidence, _ in boxes], dtype=np.float64),
    )


def view(*, camera: CameraSensor | None = AHEAD, **found: Detections2D) -> ImageView:
    return ImageView(found=found, image_size=(200, 100), camera=camera)


def solids(*boxes: Box, speed: float = 0.0) -> SolidBoxes:
    count = len(boxes)
    return SolidBoxes(
        ids=np.arange(1, count + 1),
        boxes_m=np.array([box for _, _, box in boxes], dtype=np.float64).reshape(-1, 7),
        labels=tuple(label for label, _, _ in boxes),
        confidences=np.array([confidence for _, confidence, _ in boxes], dtype=np.float64),
        sources=("tracks",) * count,
        track_ids=100 + np.arange(count),
        velocities_mps=np.tile([0.0, speed], (count, 1)),
        points=np.full(count, -1),
    )
