"""Networks that put out something else than one table of boxes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.detection.networks.network import TensorSpec
from percept.detection.networks.readings import Reading

__all__ = ["GRIDS", "special_readings", "what_else_it_is"]

Tensors = Sequence[NDArray[Any]]

# These are read only when asked for: they need anchors, which the network does not tell.
GRIDS = ("v5-grid", "v7-grid", "v4-grid")

_TENSORRT = {"num_dets", "det_boxes", "det_scores", "det_classes", "num_detections",
             "nmsed_boxes", "nmsed_scores", "nmsed_classes"}  # fmt: skip
_V7_COLUMNS = 7
_TOLERANCE = 2e-3


def special_readings(outputs: Tensors) -> list[Reading]:
    """Return the readings of outputs that are not one table of boxes."""
    grids = [o for o in outputs if o.ndim == 5]
    if len(grids) == 3 and not _tables(outputs):
        return _grid_readings(grids)
    shapes = {o.shape[-2:]: o for o in outputs if o.ndim == 4}
    if len(outputs) == 2 and (1, 4) in shapes and _tables(outputs):
        table = _tables(outputs)[0]
        if table.shape[:2] == shapes[(1, 4)].shape[:2]:
            return [Reading("v4", table.shape[2], "boxes and confidences apart")]
    if len(outputs) == 3:
        return _selected(outputs)
    if len(outputs) == 1 and _is_v7_list(outputs[0]):
        return [Reading("v7-end2end", None, "a list of finished boxes of all images")]
    return []


def _tables(outputs: Tensors) -> list[NDArray[Any]]:
    return [o for o in outputs if o.ndim == 3]


def _grid_readings(grids: list[NDArray[Any]]) -> list[Reading]:
    why = "three raw grids with three anchors in each cell"
    columns = grids[0].shape[-1]
    if any(g.shape[-1] != columns for g in grids) or columns < 6:
        return []
    if all(g.shape[1] == 3 for g in grids):
        return [Reading(name, columns - 5, why) for name in ("v5-grid", "v7-grid")]
    return [Reading("v4-grid", columns - 5, why)] if all(g.shape[3] == 3 for g in grids) else []


def _selected(outputs: Tensors) -> list[Reading]:
    """Read boxes, scores, and the (image, class, box) of those that suppression has left."""
    indices = [o for o in outputs if o.dtype.kind == "i" and o.shape[-1] == 3]
    boxes = [o for o in _tables(outputs) if o.dtype.kind == "f" and o.shape[-1] == 4]
    scores = [
        o
        for o in _tables(outputs)
        if o.dtype.kind == "f" and boxes and o is not boxes[0] and o.shape[2] == boxes[0].shape[1]
    ]
    if len(indices) != 1 or len(scores) != 1:
        return []
    return [Reading("v3", scores[0].shape[1], "boxes, scores and the numbers of those to keep")]


def _is_v7_list(table: NDArray[Any]) -> bool:
    """Tell a list of (image, x1, y1, x2, y2, class, score) from a classifier's seven scores."""
    if table.ndim != 2 or table.shape[1] != _V7_COLUMNS:
        return False
    image, label, score = table[:, 0], table[:, 5], table[:, 6]
    whole = [np.abs(v - np.rint(v)).max(initial=0) <= _TOLERANCE for v in (image, label)]
    ordered = (table[:, 3:5] >= table[:, 1:3]).all()
    return all(whole) and bool(ordered and (score >= 0).all() and (score <= 1 + _TOLERANCE).all())


def what_else_it_is(specs: Sequence[TensorSpec], outputs: Tensors) -> str | None:
    """Say what a network is that is no detector percept can read, or None."""
    if {s.name for s in specs} & _TENSORRT:
        return "it has the end-to-end outputs that are made for TensorRT"
    tables = _tables(outputs)
    if special_readings(outputs):
        return None
    if not tables:
        if any(o.ndim == 4 for o in outputs) and all(o.ndim >= 4 for o in outputs):
            return "it has the raw grids of its last layers"
        if len(outputs) == 1 and outputs[0].ndim == 2:
            return "it looks like a classifier: one row of numbers for an image"
        return "none of its outputs is a table of boxes"
    if any(o.ndim == 4 for o in outputs):
        return "it looks like a segmentation network: it puts out prototypes of masks"
    if any(t.shape != tables[0].shape for t in tables):
        return "it has several tables of different shapes"
    return None
