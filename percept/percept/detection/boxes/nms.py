"""Suppression of boxes that show one object twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.lidar.compiled import compiled

__all__ = ["suppress_duplicates"]


def suppress_duplicates(
    boxes: NDArray[np.float64],
    class_ids: NDArray[np.int64],
    scores: NDArray[np.float64],
    iou: float,
) -> NDArray[np.intp]:
    """Keep the best of the boxes of one class that overlap (greedy non-maximum suppression).

    The order is that of the scores, and among equal scores that of the boxes, so that the same
    boxes give the same answer. Areas are plain products; the one pixel that older code adds to
    widths and heights is not added.

    Args:
        boxes: (N, 4) x1, y1, x2, y2 in any unit.
        class_ids: (N,) boxes of different classes never suppress each other.
        scores: (N,) the higher the better.
        iou: Intersection over union above which the lesser box goes.

    Returns:
        Indices of the kept boxes, best first.
    """
    order = np.lexsort((-scores, class_ids))  # stable: equal scores stay in the order they came in
    kept = np.ones(len(order), np.bool_)
    _suppress(
        np.ascontiguousarray(boxes[order], dtype=np.float64),
        np.ascontiguousarray(class_ids[order], dtype=np.int64),
        iou,
        kept,
    )
    chosen = order[kept]
    best_first: NDArray[np.intp] = chosen[np.lexsort((chosen, -scores[chosen]))]
    return best_first


@compiled
def _suppress(
    boxes: NDArray[np.float64], class_ids: NDArray[np.int64], iou: float, kept: NDArray[np.bool_]
) -> None:
    """Clear `kept` for lesser boxes; they come by class, and within one best first."""
    count = len(boxes)
    for i in range(count):
        if not kept[i]:
            continue
        area = (boxes[i, 2] - boxes[i, 0]) * (boxes[i, 3] - boxes[i, 1])
        for j in range(i + 1, count):
            if class_ids[j] != class_ids[i]:
                break
            if not kept[j]:
                continue
            width = min(boxes[i, 2], boxes[j, 2]) - max(boxes[i, 0], boxes[j, 0])
            height = min(boxes[i, 3], boxes[j, 3]) - max(boxes[i, 1], boxes[j, 1])
            if width <= 0 or height <= 0:
                continue
            other = (boxes[j, 2] - boxes[j, 0]) * (boxes[j, 3] - boxes[j, 1])
            if width * height > iou * (area + other - width * height):
                kept[j] = False
