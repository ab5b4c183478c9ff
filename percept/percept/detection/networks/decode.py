"""Output tensors as boxes: one function for each family of networks.

Boxes are x1, y1, x2, y2 in pixels of the network's input, or of the image where the network is told
its size; a box has its best class, as in the demonstration programs of ultralytics and YOLOX.
Scores are compared with the threshold before any box is computed, since nearly all boxes of an
image are background.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.detection.boxes.found import FoundBoxes
from percept.detection.networks.cells import cells_of, strides_of
from percept.detection.networks.decode_grids import decode_v4_grid, decode_v5_grid, decode_v7_grid
from percept.detection.networks.layout import Layout

__all__ = ["NAMES", "decode", "main_table"]

Tensors = Sequence[NDArray[Any]]
Found = tuple[NDArray[Any], NDArray[Any], NDArray[Any]]  # boxes, class numbers, scores

_TOLERANCE = 2e-3  # of a probability in half precision


def decode(
    layout: Layout, outputs: Tensors, image_index: int, score_threshold: float
) -> FoundBoxes:
    """Return the boxes of one image, before suppression.

    Args:
        layout: How the tensors are read.
        outputs: Of the network, in its order.
        image_index: Which image of the batch.
        score_threshold: Least score of a box.

    Raises:
        InputError: If the tensors hold numbers that cannot be boxes, scores or classes: the
            network is broken, or the layout is not its own.
    """
    boxes, ids, scores = _DECODERS[layout.name](layout, outputs, image_index, score_threshold)
    if not (np.isfinite(boxes).all() and np.isfinite(scores).all()):
        raise _broken(layout, "numbers that are infinite or none at all")
    if scores.size and not 0 <= scores.min() <= scores.max() <= 1 + _TOLERANCE:
        raise _broken(layout, f"scores from {scores.min():.3g} to {scores.max():.3g}")
    ids = ids.astype(np.int64)
    if ids.size and not 0 <= ids.min() <= ids.max() < len(layout.class_names):
        raise _broken(layout, f"class {ids.max()}, but {len(layout.class_names)} class names")
    return FoundBoxes(boxes.astype(np.float64), ids, np.minimum(scores.astype(np.float64), 1.0))


def main_table(outputs: Tensors) -> NDArray[Any]:
    """Return the first output of rank 3: old exports have raw grids after it."""
    return next(o for o in outputs if o.ndim == 3)


def _broken(layout: Layout, what: str) -> InputError:
    return InputError(
        f"the network put out {what} where the layout '{layout.name}' has boxes",
        remedy="Export it again, or say which layout it has",
    )


def _corners(centres: NDArray[Any]) -> NDArray[Any]:
    """Turn (N, 4) centre x, y, width, height into corners."""
    half = centres[:, 2:] / 2
    return np.concatenate([centres[:, :2] - half, centres[:, :2] + half], axis=1)


def _single(table: NDArray[Any]) -> NDArray[Any]:
    """Return half precision as single: numpy is five times as fast with it."""
    return table.astype(np.float32) if table.dtype == np.float16 else table


def _keep(scores: NDArray[Any], threshold: float) -> NDArray[np.intp]:
    """Return where scores reach the threshold; what is no number is kept, to be found out."""
    return np.flatnonzero(~(scores < threshold))


def _v8(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, 4 + classes, N]: centre x, y, width, height and class probabilities.

    Source: ultralytics, `Detect.forward` in export.
    """
    table = _single(main_table(outputs)[image])
    at = _keep(table[4:].max(axis=0), threshold)
    kept = table[:, at].T.astype(np.float64)
    return _corners(kept[:, :4]), kept[:, 4:].argmax(axis=1), kept[:, 4:].max(axis=1)


def _v8_last(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """The same with the boxes first: [b, N, 4 + classes]."""
    table = _single(main_table(outputs)[image])
    kept = table[_keep(table[:, 4:].max(axis=1), threshold)].astype(np.float64)
    return _corners(kept[:, :4]), kept[:, 4:].argmax(axis=1), kept[:, 4:].max(axis=1)


def _v5(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, N, 5 + classes]: centre x, y, width, height, objectness and class probabilities.

    The score is the product of the last two. YOLOv7 leaves its class column untrained, and so at
    0.5 everywhere, where there is one class: then the score is the objectness.
    Source: YOLOv5 `non_max_suppression`; YOLOv7 `non_max_suppression` (`nc == 1`).
    """
    table = main_table(outputs)[image]
    if table.shape[1] == 6 and (table[:, 5] == 0.5).all():
        table = np.concatenate([table[:, :5], np.ones_like(table[:, 5:])], axis=1)
    kept, ids, scores = _with_objectness(table, threshold)[1:]
    return _corners(kept[:, :4]), ids, scores


def _with_objectness(
    table: NDArray[Any], threshold: float
) -> tuple[NDArray[np.intp], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the rows of an [N, 5 + classes] table that reach the threshold.

    Returns:
        Their numbers, the rows, best classes and scores.
    """
    rows = _keep(table[:, 4], threshold)
    kept = table[rows].astype(np.float64)
    scores = kept[:, 4] * kept[:, 5:].max(axis=1)
    at = _keep(scores, threshold)
    return rows[at], kept[at], kept[at, 5:].argmax(axis=1), scores[at]


def _yolox(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, N, 5 + classes], boxes in units of their cell: centre offset, log of width and height.

    Source: YOLOX `demo_postprocess`.
    """
    table = main_table(outputs)[image]
    at, kept, ids, scores = _with_objectness(table, threshold)
    strides = strides_of(layout.input_size, len(table))
    if strides is None:
        raise _broken(layout, f"{len(table)} boxes for an input of {layout.input_size}")
    cells, steps = cells_of(layout.input_size, strides)
    with np.errstate(over="ignore"):
        sizes = np.exp(kept[:, 2:4])
    return _corners(np.hstack([kept[:, :2] + cells[at], sizes]) * steps[at]), ids, scores


def _end2end(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, <= 1000, 6]: x1, y1, x2, y2, score, class; unused rows are zero.

    Source: ultralytics, exports of YOLOv10 and YOLO26 without NMS, and of all with `nms=True`.
    """
    rows = main_table(outputs)[image].astype(np.float64)
    kept = rows[_keep(rows[:, 4], max(threshold, np.finfo(float).tiny))]
    return kept[:, :4], np.rint(kept[:, 5]), kept[:, 4]


def _v7_end2end(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[M, 7]: number of the image, x1, y1, x2, y2, class, score.

    Source: YOLOv7 `models/experimental.py`, `ONNX_ORT`.
    """
    table = next(o for o in outputs if o.ndim == 2)
    rows = table[table[:, 0] == image].astype(np.float64)
    kept = rows[_keep(rows[:, 6], threshold)]
    return kept[:, 1:5], np.rint(kept[:, 5]), kept[:, 6]


def _rt_detr(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, <= 1000, 4 + classes]: as `v8-last`, in shares of the input's width and height.

    Source: ultralytics, `RTDETRDecoder` as older versions export it.
    """
    boxes, ids, scores = _v8_last(layout, outputs, image, threshold)
    return boxes * [*layout.input_size, *layout.input_size], ids, scores


def _rt_detr_end2end(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """[b, <= 1000, 6]: centre x, y, width, height in shares of the input; score, class.

    Source: ultralytics 8.4, `RTDETRDecoder.postprocess`.
    """
    boxes, ids, scores = _end2end(layout, outputs, image, threshold)
    return _corners(boxes) * [*layout.input_size, *layout.input_size], ids, scores


def _v4(layout: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """Boxes [b, N, 1, 4], corners in shares of the input; confidences [b, N, classes].

    Source: pytorch-YOLOv4 (Tianxiaomo), `yolo_forward_dynamic`.
    """
    boxes = next(o for o in outputs if o.ndim == 4)[image, :, 0]
    table = main_table(outputs)[image]
    at = _keep(table.max(axis=1), threshold)
    kept = table[at].astype(np.float64)
    size = [*layout.input_size, *layout.input_size]
    return boxes[at].astype(np.float64) * size, kept.argmax(axis=1), kept.max(axis=1)


def _v3(_: Layout, outputs: Tensors, image: int, threshold: float) -> Found:
    """Boxes [b, N, 4] as y1, x1, y2, x2; scores [b, classes, N]; (image, class, box) to keep.

    Source: ONNX model zoo, YOLOv3; its boxes are in pixels of the `image_shape` that it was given.
    """
    indices = next(o for o in outputs if o.dtype.kind == "i").reshape(-1, 3)
    boxes = next(o for o in outputs if o.dtype.kind == "f" and o.shape[-1] == 4)
    scores = next(o for o in outputs if o.dtype.kind == "f" and o is not boxes)
    _, ids, at = indices[indices[:, 0] == image].T
    found = scores[image, ids, at].astype(np.float64)
    kept = _keep(found, threshold)
    return boxes[image, at[kept]][:, [1, 0, 3, 2]], ids[kept], found[kept]


_DECODERS: dict[str, Callable[[Layout, Tensors, int, float], Found]] = {
    "v8": _v8,
    "v8-last": _v8_last,
    "v5": _v5,
    "yolox": _yolox,
    "end2end": _end2end,
    "v7-end2end": _v7_end2end,
    "rt-detr": _rt_detr,
    "rt-detr-end2end": _rt_detr_end2end,
    "v4": _v4,
    "v3": _v3,
    "v5-grid": decode_v5_grid,
    "v7-grid": decode_v7_grid,
    "v4-grid": decode_v4_grid,
}
NAMES = tuple(_DECODERS)
