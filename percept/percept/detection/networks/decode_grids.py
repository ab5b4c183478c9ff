"""Raw grids of anchor-based networks, which know neither their anchors nor their strides.

The anchors are those that the networks were published with, for COCO. A network that was trained
with anchors of its own would give boxes of wrong sizes: such grids are read only when asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.detection.networks.layout import Layout

__all__ = ["decode_v4_grid", "decode_v5_grid", "decode_v7_grid"]

# Widths and heights in pixels, for the strides 8, 16 and 32.
_V5 = np.array(
    [[10, 13, 16, 30, 33, 23], [30, 61, 62, 45, 59, 119], [116, 90, 156, 198, 373, 326]]
).reshape(3, 3, 2)
_V7 = np.array(
    [[12, 16, 19, 36, 40, 28], [36, 75, 76, 55, 72, 146], [142, 110, 192, 243, 459, 401]]
).reshape(3, 3, 2)
_V4_XY_SCALES = (1.2, 1.1, 1.05)

Found = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]
Tensors = Sequence[NDArray[Any]]


def decode_v5_grid(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """Three [b, 3, rows, columns, 5 + classes]: xy = (2s - 0.5 + cell) stride, wh = (2s)^2 anchor.

    Source: YOLOv5 `Detect.forward`, with s the logistic function of the output.
    """
    return _decode_centred(layout, outputs, image, threshold, _V5)


def decode_v7_grid(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """The same with the anchors of YOLOv7; YOLOv7-tiny has those of YOLOv5."""
    return _decode_centred(layout, outputs, image, threshold, _V7)


def decode_v4_grid(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """Three [b, rows, columns, 3, 5 + classes], wh = exp(v) anchor, xy scaled about the cell.

    Source: ONNX model zoo, YOLOv4, `postprocess_bbbox`.
    """
    parts = []
    for level, grid in enumerate(_fine_first(outputs, rows_axis=1)):
        rows, cells, anchor = _hits(grid[image].transpose(2, 0, 1, 3), threshold)
        scale = _V4_XY_SCALES[level]
        stride = layout.input_size[1] / grid.shape[1]
        xy = (_logistic(rows[:, :2]) * scale - 0.5 * (scale - 1) + cells) * stride
        with np.errstate(over="ignore"):
            wh = np.exp(rows[:, 2:4]) * _V7[level][anchor]
        parts.append(_found(xy, wh, rows, threshold))
    return _joined(parts)


def _decode_centred(
    layout: Layout, outputs: Tensors, image: int, threshold: float, anchors: NDArray[Any]
) -> Found:
    parts = []
    for level, grid in enumerate(_fine_first(outputs, rows_axis=2)):
        rows, cells, anchor = _hits(grid[image], threshold)
        stride = layout.input_size[1] / grid.shape[2]
        xy = (2 * _logistic(rows[:, :2]) - 0.5 + cells) * stride
        wh = (2 * _logistic(rows[:, 2:4])) ** 2 * anchors[level][anchor]
        parts.append(_found(xy, wh, rows, threshold))
    return _joined(parts)


def _fine_first(outputs: Tensors, *, rows_axis: int) -> list[NDArray[Any]]:
    return sorted((o for o in outputs if o.ndim == 5), key=lambda o: -o.shape[rows_axis])


def _hits(
    grid: NDArray[Any], threshold: float
) -> tuple[NDArray[np.float64], NDArray[Any], NDArray[np.intp]]:
    """Return of an (anchors, rows, columns, values) grid where the objectness is high enough.

    Returns:
        The values (N, 5 + classes), the cells' (N, 2) column and row, and their anchors.
    """
    least = np.log(max(threshold, 1e-6) / max(1 - threshold, 1e-6))
    anchor, row, column = np.nonzero(~(grid[..., 4] < least))
    values = grid[anchor, row, column].astype(np.float64)
    return values, np.stack([column, row], axis=1), anchor


def _found(
    xy: NDArray[Any], wh: NDArray[Any], rows: NDArray[np.float64], threshold: float
) -> Found:
    probabilities = _logistic(rows[:, 4:])
    scores = probabilities[:, 0] * probabilities[:, 1:].max(axis=1)
    at = np.flatnonzero(~(scores < threshold))
    boxes = np.concatenate([xy - wh / 2, xy + wh / 2], axis=1)
    return boxes[at], probabilities[at, 1:].argmax(axis=1), scores[at]


def _joined(parts: Sequence[Found]) -> Found:
    boxes, ids, scores = zip(*parts, strict=True)
    return np.concatenate(boxes), np.concatenate(ids), np.concatenate(scores)


def _logistic(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 + 0.5 * np.tanh(values / 2))
