"""Several networks on one image: which of them found an object best."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D

__all__ = ["primary_boxes"]

_F64 = NDArray[np.float64]


def primary_boxes(
    boxes: Mapping[str, Detections2D], iou: float = 0.45
) -> dict[str, NDArray[np.bool_]]:
    """Mark the boxes to count where several models found one object in one image.

    Boxes of different models are one object where they have the same class, whatever its case,
    and overlap enough. The most confident counts; of equals, that of the model that comes first.
    Boxes of one model never compete: its own suppression has settled that.

    Args:
        boxes: What each model found in the image, by its name.
        iou: Intersection over union above which two boxes are one object.

    Returns:
        By model (N,) bool, True for the boxes to count.
    """
    sizes = [len(found) for found in boxes.values()]
    model = np.repeat(np.arange(len(sizes)), sizes)
    if not len(model):
        return {name: np.zeros(0, np.bool_) for name in boxes}
    boxes_px = np.concatenate([found.boxes_px for found in boxes.values()])
    labels = np.array([label.casefold() for found in boxes.values() for label in found.labels])
    confidences = np.concatenate([found.confidences for found in boxes.values()])
    primary = np.zeros(len(model), np.bool_)
    for row in np.argsort(-confidences, kind="stable"):
        rivals = primary & (model != model[row]) & (labels == labels[row])
        primary[row] = not (_iou(boxes_px[row], boxes_px[rivals]) > iou).any()
    ends = np.cumsum(sizes)[:-1]
    return dict(zip(boxes, np.split(primary, ends), strict=True))


def _iou(box_px: _F64, others_px: _F64) -> _F64:
    """Return the intersection over union (N,) of one box (4,) with others (N, 4)."""
    low = np.maximum(box_px[:2], others_px[:, :2])
    high = np.minimum(box_px[2:], others_px[:, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=1)
    areas = (others_px[:, 2:] - others_px[:, :2]).prod(axis=1)
    union = (box_px[2:] - box_px[:2]).prod() + areas - shared
    ratio: _F64 = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return ratio
