"""What stands between an eye and a point: boxes that lines of sight pass through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["is_hidden"]

_F64 = NDArray[np.float64]
_BEFORE = 0.98  # of the way: a box about the point itself does not hide it


def is_hidden(eye: _F64, points: _F64, boxes_m: _F64) -> NDArray[np.bool_]:
    """Return which points (N,) a box hides from an eye (slabs: Kay and Kajiya 1986).

    Args:
        eye: (3,) metres.
        points: (N, 3) metres in the same frame.
        boxes_m: (M, 7) centre x, y, z, length, width, height and yaw about z, in that frame.
    """
    from percept.core.sight_line_kernels import hide

    boxes = np.asarray(boxes_m, dtype=np.float64).reshape(-1, 7)
    hidden = np.zeros(len(points), bool)
    cos, sin = np.cos(boxes[:, 6]), np.sin(boxes[:, 6])
    x, y, z = (eye - boxes[:, :3]).T
    starts = np.column_stack([cos * x + sin * y, cos * y - sin * x, z])
    axes = np.column_stack([cos, sin])
    ways = np.asarray(points - eye, dtype=np.float64)
    hide(starts, axes, boxes[:, 3:6] / 2, ways, _BEFORE, hidden)
    return hidden
