"""KITTI's rows of an object: class, how visible it is, its rectangle, and its box in 3D.

Geiger et al., object development kit, readme: camera frame x right, y down, z forward; the place
is the middle of the bottom, the turn is about y, and alpha is the turn less the bearing.

A KITTI box stands upright in the frame of the camera, ours in that of the vehicle. A camera that
looks a little down cannot tell both at once: the centre, the size and the heading seen along the
camera's y axis are exact, and the box leans by the camera's tilt.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from percept.core.transform import Transform
from percept.datasets.labelling.formats.camera_views import CameraView
from percept.datasets.labelling.labelled_set import SolidBoxes
from percept.datasets.labels.kitti_tracking import DONT_CARE, from_kitti_boxes, to_kitti_boxes

__all__ = [
    "from_camera_boxes",
    "kitti_rows",
    "kitti_types",
    "row_text",
    "tilt_deg",
    "to_camera_boxes",
]

_F64 = NDArray[np.float64]

# Optical frame (x right, y down, z forward) from one with x forward, y left, z up.
_OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
_NO_ALPHA, _NO_SIZE, _NO_PLACE, _NO_TURN = -10.0, -1.0, -1000.0, -10.0
_NO_BOX = np.array([*[_NO_SIZE] * 3, *[_NO_PLACE] * 3, _NO_TURN])
_NOT_KNOWN_HIDDEN = 3
_PARTLY_HIDDEN = (0.1, 0.5)
_NOT_KNOWN_CUT = -1.0


def kitti_types(categories: Sequence[str]) -> dict[str, str]:
    """Return KITTI's word for each class: its name without white space, and never `DontCare`."""
    types: dict[str, str] = {}
    for name in categories:
        word = re.sub(r"\s+", "_", name) or "_"
        while word in types.values() or word == DONT_CARE:
            word += "_"
        types[name] = word
    return types


def to_camera_boxes(boxes_m: _F64, T_camera_base: Transform) -> _F64:
    """Return boxes of the base frame as KITTI has them.

    Args:
        boxes_m: (N, 7) centre, length, width, height, yaw in the base frame.
        T_camera_base: From that frame into the camera's.

    Returns:
        (N, 7) height, width, length, x, y, z of the middle of the bottom, turn about y.
    """
    yaw = boxes_m[:, 6]
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    seen = heading @ T_camera_base.rotation.T @ _OPTICAL
    centres = T_camera_base.apply(boxes_m[:, :3]) @ _OPTICAL
    turned = np.arctan2(seen[:, 1], seen[:, 0])
    return to_kitti_boxes(np.column_stack([centres, boxes_m[:, 3:6], turned]))


def from_camera_boxes(boxes: _F64, T_camera_base: Transform) -> _F64:
    """Return KITTI's boxes in the base frame; the reverse of `to_camera_boxes`.

    The heading is the level one that looks like the box's along the camera's y axis.

    Args:
        boxes: (N, 7) height, width, length, x, y, z, turn.
        T_camera_base: From the base frame into the camera's.

    Returns:
        (N, 7) centre, length, width, height, yaw in the base frame.
    """
    level = from_kitti_boxes(boxes)
    T_base_camera = T_camera_base.inverse()
    centres = T_base_camera.apply(level[:, :3] @ _OPTICAL.T)
    yaw = level[:, 6]
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    turned = heading @ _OPTICAL.T @ T_base_camera.rotation.T
    down = T_base_camera.rotation[:, 1]
    turned = turned - turned[:, 2:] / down[2] * down
    return np.column_stack([centres, level[:, 3:6], np.arctan2(turned[:, 1], turned[:, 0])])


def tilt_deg(T_camera_base: Transform) -> float:
    """Return the angle between the camera's y axis and straight down in the base frame."""
    return float(np.degrees(np.arccos(np.clip(-T_camera_base.rotation[1, 2], -1, 1))))


def kitti_rows(view: CameraView, solids: SolidBoxes) -> _F64:
    """Return KITTI's numbers of the boxes of an image.

    Args:
        view: The image.
        solids: The 3D boxes of its keyframe.

    Returns:
        (N, 14) truncated, occluded, alpha, x1, y1, x2, y2, height, width, length, x, y, z, turn.
        A rectangle without 3D box has KITTI's numbers for unknown: size -1, place -1000, -10.
    """
    camera_boxes = to_camera_boxes(solids.boxes_m, view.T_camera_base)
    row_of = {int(number): row for row, number in enumerate(solids.ids)}
    rows = np.empty((len(view.boxes), 14))
    for row, number in enumerate(view.boxes.solids):
        at = row_of.get(int(number))
        rows[row, 7:] = _NO_BOX if at is None else camera_boxes[at]
    alpha = rows[:, 13] - np.arctan2(rows[:, 10], rows[:, 12])
    wrapped = np.pi - np.mod(np.pi - alpha, 2 * np.pi)
    rows[:, 0] = np.nan_to_num(view.boxes.truncated, nan=_NOT_KNOWN_CUT)
    rows[:, 1] = _hidden_level(view.boxes.occluded)
    rows[:, 2] = np.where(rows[:, 7] == _NO_SIZE, _NO_ALPHA, wrapped)
    rows[:, 3:7] = view.boxes.boxes_px
    return rows


def row_text(kind: str, row: _F64, *, whole_truncated: bool = False) -> str:
    """Return the text of an object, without what a format has before and after it.

    Args:
        kind: KITTI's word for the class.
        row: (14,) as `kitti_rows` returns them.
        whole_truncated: Whether truncation is a level 0, 1, 2 as in the tracking benchmark,
            instead of a share.
    """
    cut = f"{_cut_level(row[0])}" if whole_truncated else f"{row[0]:.2f}"
    return " ".join([kind, cut, f"{row[1]:.0f}", *(f"{value:.6f}" for value in row[2:])])


def _hidden_level(shares: _F64) -> NDArray[np.int64]:
    levels = np.digitize(shares, _PARTLY_HIDDEN, right=True)
    return np.where(np.isnan(shares), _NOT_KNOWN_HIDDEN, levels)


def _cut_level(share: float) -> int:
    return -1 if share < 0 else int(np.digitize(share, _PARTLY_HIDDEN, right=True))
