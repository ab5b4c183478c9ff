"""How much boxes overlap: IoU from above and in space, and the generalised IoU in space.

All are exact for boxes that are turned about z by any angle: the outline that two boxes share is
cut out as a polygon.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["giou_3d", "iou_3d", "iou_bev"]

_F64 = NDArray[np.float64]


def iou_bev(boxes_m: _F64, others_m: _F64) -> _F64:
    """Return the intersection over union of the boxes' outlines seen from above.

    Args:
        boxes_m: (N, 7) float64 centre x, y, z, length, width, height in metres and yaw in rad.
        others_m: (M, 7) float64 in the same frame.

    Returns:
        (N, M) float64 in 0..1; 0 where both boxes have no area.

    Raises:
        GeometryError: If a box has not seven columns, is not finite, or has a negative size.
    """
    from percept.core.box_overlap_kernels import fill_iou_bev

    boxes, others, out = _checked(boxes_m, others_m)
    fill_iou_bev(boxes, others, out)
    return out


def iou_3d(boxes_m: _F64, others_m: _F64) -> _F64:
    """Return the intersection over union of the boxes' volumes.

    Args:
        boxes_m: (N, 7) float64 centre x, y, z, length, width, height in metres and yaw in rad.
        others_m: (M, 7) float64 in the same frame.

    Returns:
        (N, M) float64 in 0..1; 0 where both boxes have no volume.

    Raises:
        GeometryError: If a box has not seven columns, is not finite, or has a negative size.
    """
    from percept.core.box_overlap_kernels import fill_iou_3d

    boxes, others, out = _checked(boxes_m, others_m)
    fill_iou_3d(boxes, others, out)
    return out


def giou_3d(boxes_m: _F64, others_m: _F64, *, within_m: float = math.inf) -> _F64:
    """Return the generalised IoU in space, which tells near boxes from far ones without overlap.

    IoU - (hull - union) / hull (Rezatofighi et al., 2019, equation 4), where the hull is the
    convex hull of both outlines from above, over the whole span of heights, as 3D trackers
    take it.

    Args:
        boxes_m: (N, 7) float64 centre x, y, z, length, width, height in metres and yaw in rad.
        others_m: (M, 7) float64 in the same frame.
        within_m: Pairs whose centres are farther apart from above get -1 and cost no time.

    Returns:
        (N, M) float64 in -1..1.

    Raises:
        GeometryError: If a box has not seven columns, is not finite, or has a negative size.
    """
    from percept.core.box_overlap_kernels import fill_giou_3d

    boxes, others, out = _checked(boxes_m, others_m)
    fill_giou_3d(boxes, others, within_m, out)
    return out


def _checked(boxes_m: _F64, others_m: _F64) -> tuple[_F64, _F64, _F64]:
    both = []
    for boxes in (boxes_m, others_m):
        if boxes.ndim != 2 or boxes.shape[1] != 7:
            raise GeometryError(f"boxes are (N, 7), not {boxes.shape}")
        if not np.isfinite(boxes).all() or (boxes[:, 3:6] < 0).any():
            raise GeometryError("boxes must be finite and their sizes not negative")
        both.append(np.ascontiguousarray(boxes, dtype=np.float64))
    return both[0], both[1], np.empty((len(boxes_m), len(others_m)))
