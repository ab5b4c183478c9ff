"""How alike the boxes of labels and of tracks are, in 0..1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.box_overlap import iou_3d
from percept.core.tracked_boxes import TrackedBoxes

__all__ = ["centre_closeness", "image_iou", "image_overlap", "space_iou"]

_GATE_M = 2.0

_F64 = NDArray[np.float64]


def image_iou(truth: TrackedBoxes, tracks: TrackedBoxes) -> _F64:
    """Return the IoU (N, M) of boxes in the image; 0 of those without one."""
    shared, areas, others = _shared_areas(truth.boxes_px, tracks.boxes_px)
    union = areas[:, None] + others[None, :] - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def image_overlap(boxes_px: _F64, regions_px: _F64) -> _F64:
    """Return the share (N, M) of each box (N, 4) that lies in each region (M, 4); 0 of none."""
    shared, areas, _ = _shared_areas(boxes_px, regions_px)
    whole = np.broadcast_to(areas[:, None], shared.shape)
    return np.divide(shared, whole, out=np.zeros_like(shared), where=whole > 0)


def space_iou(truth: TrackedBoxes, tracks: TrackedBoxes) -> _F64:
    """Return the IoU (N, M) of the boxes' volumes."""
    return iou_3d(truth.boxes_m, tracks.boxes_m)


def centre_closeness(truth: TrackedBoxes, tracks: TrackedBoxes) -> _F64:
    """Return how near the centres are from above (N, M): 1 in one place, 0.5 at the gate.

    The gate is 2 m, at which nuScenes takes boxes for one object, or half the diagonal of the
    truth box where that is more: a LiDAR sees one side of an object, which shifts its centre by up
    to that. At twice the gate the similarity is 0.
    """
    offsets = truth.boxes_m[:, None, :2] - tracks.boxes_m[None, :, :2]
    distance = np.hypot(offsets[..., 0], offsets[..., 1])
    gates = np.maximum(_GATE_M, np.hypot(truth.boxes_m[:, 3], truth.boxes_m[:, 4]) / 2.0)
    return np.asarray(np.clip(1.0 - distance / (2.0 * gates[:, None]), 0.0, 1.0))


def _shared_areas(boxes: _F64, others: _F64) -> tuple[_F64, _F64, _F64]:
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    shared = np.nan_to_num(np.clip(high - low, 0.0, None)).prod(axis=2)
    areas, other_areas = (
        np.nan_to_num(np.clip(part[:, 2:] - part[:, :2], 0.0, None)).prod(axis=1)
        for part in (boxes, others)
    )
    return shared, areas, other_areas
