"""Known boxes, and how each family of detectors would put them out.

Each encoder is the inverse of what its family's decoding does, written down independently of the
decoders in `percept.detection`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ENCODERS", "Cells", "KnownBoxes", "Output", "known_boxes"]

Floats = NDArray[np.float64]

_V5_ANCHORS = np.array(
    [[10, 13, 16, 30, 33, 23], [30, 61, 62, 45, 59, 119], [116, 90, 156, 198, 373, 326]], float
).reshape(3, 3, 2)
_V4_ANCHORS = np.array(
    [[12, 16, 19, 36, 40, 28], [36, 75, 76, 55, 72, 146], [142, 110, 192, 243, 459, 401]], float
).reshape(3, 3, 2)


@dataclass(frozen=True)
class KnownBoxes:
    """What a network must be read as.

    Attributes:
        boxes: (N, 4) x1, y1, x2, y2 in the network's input image, pixels.
        class_ids: (N,) int.
        scores: (N,) in 0..1.
    """

    boxes: Floats
    class_ids: NDArray[np.int64]
    scores: Floats


def known_boxes(class_count: int = 80, size: tuple[int, int] = (640, 640)) -> KnownBoxes:
    """Return four boxes, far apart and of odd sizes, that fit into an input of `size` (w, h)."""
    w, h = size
    corners = [[0.05, 0.06, 0.31, 0.27], [0.52, 0.11, 0.93, 0.38], [0.07, 0.55, 0.13, 0.66],
               [0.45, 0.61, 0.97, 0.88]]  # fmt: skip
    ids = np.array([0, class_count - 1, class_count // 2, 1 % class_count])
    return KnownBoxes(np.array(corners) * [w, h, w, h], ids, np.array([0.91, 0.78, 0.63, 0.55]))


@dataclass
class Output:
    """A constant output [1, ...].

    Attributes:
        values: What is always put out.
        scores: What is added where the network fires.
        cells_last: Whether the last axis, not the second, counts the boxes.
    """

    values: NDArray[Any]
    scores: NDArray[Any] | None = None
    cells_last: bool = False


class Cells:
    """The cells of a detector's grids, level by level and row by row."""

    def __init__(self, size: tuple[int, int], strides: Sequence[int]) -> None:
        levels = []
        for s in strides:
            rows, columns = -(-size[1] // s), -(-size[0] // s)
            y, x = np.mgrid[:rows, :columns]
            levels.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, s)], 1))
        self.strides = tuple(strides)
        self.shapes = [(-(-size[1] // s), -(-size[0] // s)) for s in strides]
        self.x, self.y, self.stride = np.concatenate(levels).T.astype(float)

    def of(self, known: KnownBoxes) -> list[int]:
        """Return the cell of each box: its middle lies in it; small boxes have fine grids."""
        chosen = []
        for x1, y1, x2, y2 in known.boxes:
            wanted = np.clip((x2 - x1 + y2 - y1) / 8, min(self.strides), max(self.strides))
            stride = max(s for s in self.strides if s <= wanted)
            at = (self.stride == stride) & (self.x == (x1 + x2) / 2 // stride)
            chosen.append(int(np.flatnonzero(at & (self.y == (y1 + y2) / 2 // stride))[0]))
        return chosen


def _centres(boxes: Floats) -> Floats:
    return np.hstack([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]])


def _table(
    known: KnownBoxes, count: int, cells: Cells | None, *, repeat: int = 1, objectness: bool = False
) -> tuple[Floats, Floats, list[int]]:
    """Return decoded boxes (1, A, 4), scores (1, A, columns) and the row of each known box."""
    n = len(known.boxes) if cells is None else len(cells.x) * repeat
    boxes, scores = np.zeros((n, 4)), np.zeros((n, count + objectness))
    at = list(range(len(known.boxes)))
    if cells is not None:
        x, y, s = (np.tile(v, repeat) for v in (cells.x, cells.y, cells.stride))
        boxes[:] = np.stack([(x + 0.5) * s, (y + 0.5) * s, 2 * s, 3 * s], 1)
        scores[:] = np.random.default_rng(1).uniform(1e-6, 0.01, scores.shape)
        at = cells.of(known)
    boxes[at] = _centres(known.boxes)
    scores[at, known.class_ids + objectness] = known.scores / (0.96 if objectness else 1)
    if objectness:
        # Where there is no object the classes of such networks are anything: see YOLOX-nano.
        rest = np.setdiff1d(np.arange(n), at)
        scores[rest, 1:] = np.random.default_rng(5).uniform(0, 0.6, (len(rest), count))
        scores[at, 0] = 0.96
    return boxes[None], scores[None], at


def _joined(boxes: Floats, scores: Floats, *, channels_first: bool = False) -> Output:
    values = np.concatenate([boxes, np.zeros_like(scores)], 2)
    fired = np.concatenate([np.zeros_like(boxes), scores], 2)
    if channels_first:
        values, fired = values.transpose(0, 2, 1), fired.transpose(0, 2, 1)
    return Output(values, fired, cells_last=channels_first)


Outputs = Mapping[str, NDArray[Any] | Output]
Encoder = Callable[[KnownBoxes, int, Cells | None, tuple[int, int]], Outputs]


def _v8(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    boxes, scores, _at = _table(known, count, cells)
    return {"output0": _joined(boxes, scores, channels_first=True)}


def _v8_last(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    boxes, scores, _at = _table(known, count, cells)
    return {"output0": _joined(boxes, scores)}


def _v5(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    boxes, scores, _at = _table(known, count, cells, repeat=3, objectness=True)
    return {"output": _joined(boxes, scores)}


def _v6(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    boxes, scores, at = _table(known, count, cells, objectness=True)
    scores *= scores[..., :1]
    scores[..., 0] = 1
    scores[0, at, known.class_ids + 1] = known.scores
    return {"outputs": _joined(boxes, scores)}


def _yolox_decoded(
    known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]
) -> Outputs:
    boxes, scores, _at = _table(known, count, cells, objectness=True)
    return {"output": _joined(boxes, scores)}


def _yolox(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    assert cells is not None
    boxes, scores, _at = _table(known, count, cells, objectness=True)
    corner, s = np.stack([cells.x, cells.y], 1), cells.stride[:, None]
    raw = np.concatenate([boxes[0, :, :2] / s - corner, np.log(boxes[0, :, 2:] / s)], 1)
    raw += np.random.default_rng(2).normal(0, 0.3, raw.shape) * (scores[0, :, :1] < 0.5)
    return {"output": _joined(raw[None], scores)}


def _end2end(known: KnownBoxes, _n: int, _c: Cells | None, _: tuple[int, int]) -> Outputs:
    rows = np.zeros((1, 300, 6))
    fired = np.zeros_like(rows)
    rows[0, : len(known.boxes), :4] = known.boxes
    rows[0, : len(known.boxes), 5] = known.class_ids
    fired[0, : len(known.boxes), 4] = known.scores
    return {"output0": Output(rows, fired)}


def _v7_end2end(known: KnownBoxes, _n: int, _c: Cells | None, _: tuple[int, int]) -> Outputs:
    columns = [np.zeros(len(known.scores)), *known.boxes.T, known.class_ids, known.scores]
    return {"output": np.stack(columns, 1)}


def _rt_detr(known: KnownBoxes, count: int, _c: Cells | None, size: tuple[int, int]) -> Outputs:
    random = np.random.default_rng(3)
    boxes = random.uniform(0.1, 0.9, (300, 4))
    scores = random.uniform(1e-6, 0.01, (300, count))
    boxes[: len(known.boxes)] = _centres(known.boxes) / [*size, *size]
    scores[np.arange(len(known.boxes)), known.class_ids] = known.scores
    return {"output0": _joined(boxes[None], scores[None])}


def _rt_detr_end2end(
    known: KnownBoxes, count: int, _c: Cells | None, size: tuple[int, int]
) -> Outputs:
    random = np.random.default_rng(3)
    rows, fired = np.zeros((2, 1, 300, 6))
    rows[0, :, :4] = random.uniform(0.1, 0.9, (300, 4))
    rows[0, :, 5] = random.integers(0, count, 300)
    fired[0, :, 4] = random.uniform(1e-6, 0.01, 300)
    n = len(known.boxes)
    rows[0, :n, :4] = _centres(known.boxes) / [*size, *size]
    rows[0, :n, 5] = known.class_ids
    fired[0, :n, 4] = known.scores
    return {"output0": Output(rows, fired)}


def _v4(known: KnownBoxes, count: int, cells: Cells | None, size: tuple[int, int]) -> Outputs:
    boxes, scores, _at = _table(known, count, cells, repeat=3)
    half = boxes[..., 2:] / 2
    corners = np.concatenate([boxes[..., :2] - half, boxes[..., :2] + half], 2)
    confs = Output(np.zeros_like(scores), scores)
    return {"boxes": (corners / [*size, *size])[:, :, None], "confs": confs}


def _v3(known: KnownBoxes, count: int, _c: Cells | None, _: tuple[int, int]) -> Outputs:
    boxes = np.zeros((1, 50, 4))
    scores = np.zeros((1, count, 50))
    n = len(known.boxes)
    boxes[0, 10 : 10 + n] = known.boxes[:, [1, 0, 3, 2]]
    scores[0, known.class_ids, 10 + np.arange(n)] = known.scores
    indices = np.stack([np.zeros(n), known.class_ids, 10 + np.arange(n)], 1).astype(np.int32)
    return {"boxes:0": boxes, "scores:0": scores, "indices:0": indices}


def _logit(values: Floats) -> Floats:
    clipped = np.clip(values, 1e-6, 1 - 1e-6)
    return np.log(clipped / (1 - clipped))


def _level_arrays(
    known: KnownBoxes, count: int, cells: Cells
) -> list[tuple[Floats, list[tuple[int, int, int]]]]:
    """Return by level logits (rows, columns, 3, 5 + count) and (y, x, number) of its boxes."""
    levels = []
    chosen = cells.of(known)
    for stride, shape in zip(cells.strides, cells.shapes, strict=True):
        grid = np.random.default_rng(4).normal(-7, 0.3, (*shape, 3, 5 + count))
        grid[..., :4] += 7
        inside = [
            (int(cells.y[c]), int(cells.x[c]), k)
            for k, c in enumerate(chosen)
            if cells.stride[c] == stride
        ]
        for y, x, k in inside:
            grid[y, x, 1, 4] = _logit(np.array(0.96))
            grid[y, x, 1, 5 + known.class_ids[k]] = _logit(known.scores[k] / 0.96)
        levels.append((grid, inside))
    return levels


def _raw_v5(anchors: Floats) -> Encoder:
    def encode(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
        assert cells is not None
        outputs = {}
        for i, (grid, inside) in enumerate(_level_arrays(known, count, cells)):
            for y, x, k in inside:
                centre = _centres(known.boxes[k : k + 1])[0]
                grid[y, x, 1, :2] = _logit((centre[:2] / cells.strides[i] - [x, y] + 0.5) / 2)
                grid[y, x, 1, 2:4] = _logit(np.sqrt(centre[2:] / anchors[i, 1]) / 2)
            outputs[f"grid{i}"] = grid.transpose(2, 0, 1, 3)[None]
        return outputs

    return encode


def _raw_v4(known: KnownBoxes, count: int, cells: Cells | None, _: tuple[int, int]) -> Outputs:
    assert cells is not None
    outputs = {}
    for i, (grid, inside) in enumerate(_level_arrays(known, count, cells)):
        scale = (1.2, 1.1, 1.05)[i]
        for y, x, k in inside:
            centre = _centres(known.boxes[k : k + 1])[0]
            offset = centre[:2] / cells.strides[i] - [x, y]
            grid[y, x, 1, :2] = _logit((offset + 0.5 * (scale - 1)) / scale)
            grid[y, x, 1, 2:4] = np.log(centre[2:] / _V4_ANCHORS[i, 1])
        outputs[f"Identity_{i}:0"] = grid[None]
    return outputs


ENCODERS: Mapping[str, Encoder] = {
    "v8": _v8,
    "v8-last": _v8_last,
    "v5": _v5,
    "v6": _v6,
    "yolox-decoded": _yolox_decoded,
    "yolox": _yolox,
    "end2end": _end2end,
    "v7-end2end": _v7_end2end,
    "rt-detr": _rt_detr,
    "rt-detr-end2end": _rt_detr_end2end,
    "v4": _v4,
    "v3": _v3,
    "v5-grid": _raw_v5(_V5_ANCHORS),
    "v7-grid": _raw_v5(_V4_ANCHORS),
    "v4-grid": _raw_v4,
}
