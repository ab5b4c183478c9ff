"""Which box of one labelling is which of another, one to one.

A box that is still where it was comes first, then one that kept its number, then overlap; last a
number alone, for a box that was dragged far away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["BoxColumn", "Likeness", "ids_agree", "image_likeness", "pair_boxes", "solid_likeness"]

_F64 = NDArray[np.float64]
_I64 = NDArray[np.int64]
_Ints = NDArray[np.intp]

_SAME_LABEL = 0.1  # of IoU, so much a class that stays is worth
_NEAR_M = 2.0
_NOT_AT_ALL = -1.0


@dataclass(frozen=True, slots=True, eq=False)
class BoxColumn:
    """What is known of N boxes beside their places: class names, and numbers with 0 for none."""

    labels: Sequence[str]
    ids: _I64


@dataclass(frozen=True, slots=True, eq=False)
class Likeness:
    """How much N boxes are like M others.

    Attributes:
        overlap: (N, M) 0..1; 0 where they cannot be the same object.
        shift: (N, M) how far the sides are apart at most, in px or m.
        iou: (N, M) intersection over union.
    """

    overlap: _F64
    shift: _F64
    iou: _F64


def image_likeness(boxes_px: _F64, others_px: _F64) -> Likeness:
    """Return how much boxes (N, 4) are like others (M, 4), x1 y1 x2 y2 in px."""
    a, b = boxes_px[:, None, :], others_px[None, :, :]
    shared = np.minimum(a[..., 2:], b[..., 2:]) - np.maximum(a[..., :2], b[..., :2])
    both = np.clip(shared, 0, None).prod(axis=-1)
    areas = [(box[..., 2:] - box[..., :2]).prod(axis=-1) for box in (a, b)]
    union = areas[0] + areas[1] - both
    iou = np.divide(both, union, out=np.zeros_like(both), where=union > 0)
    return Likeness(overlap=iou, shift=_largest(np.abs(a - b)), iou=iou)


def solid_likeness(boxes_m: _F64, others_m: _F64) -> Likeness:
    """Return how much boxes (N, 7) are like others (M, 7), centre, size and yaw.

    The overlap is that from above; thin objects that a small shift brings apart count by the
    distance of their centres, down to 0 at 2 m. The shift is the largest of those of the centre, of
    the size, and of the ends of the box by its turn.
    """
    from percept.core.box_overlap import iou_bev

    a, b = boxes_m[:, None, :], others_m[None, :, :]
    apart = np.linalg.norm(a[..., :3] - b[..., :3], axis=-1)
    turned = np.abs(np.angle(np.exp(1j * (a[..., 6] - b[..., 6]))))
    ends = turned * np.maximum(a[..., 3], b[..., 3]) / 2
    sizes = _largest(np.abs(a[..., 3:6] - b[..., 3:6]))
    iou = iou_bev(boxes_m, others_m)
    return Likeness(
        overlap=np.maximum(iou, np.clip(1 - apart / _NEAR_M, 0, None)),
        shift=np.maximum(np.maximum(apart, sizes), ends),
        iou=iou,
    )


def ids_agree(places: Mapping[int, object], others: Mapping[int, object]) -> bool:
    """Return whether the numbers of boxes mean the same boxes in two labellings.

    A tool that counts anew gives old numbers to boxes of other images. One such is enough.

    Args:
        places: The image of each numbered box of one.
        others: The same of the other.
    """
    return all(others.get(number, place) == place for number, place in places.items())


def pair_boxes(
    column: BoxColumn, other: BoxColumn, likeness: Likeness, *, same: float, least_overlap: float
) -> list[tuple[int, int]]:
    """Return pairs of rows (of N boxes, of M others), in the order of the first.

    Args:
        column: Classes and numbers of N boxes.
        other: Of M others; numbers of 0 throughout where they mean nothing.
        likeness: (N, M) of both.
        same: A shift below which a box of the same class did not move.
        least_overlap: From which boxes can be one object without a number that says so.
    """
    rows, columns = likeness.shift.shape
    if not rows or not columns:
        return []
    labels = np.array(column.labels, object)[:, None] == np.array(other.labels, object)[None, :]
    numbers = (column.ids[:, None] == other.ids[None, :]) & (column.ids[:, None] > 0)
    enough = likeness.overlap >= least_overlap
    # Larger is better; a negative worth is no pair. Each round takes from what is left.
    rounds = (
        np.where(labels & (likeness.shift < same), 1 + numbers - likeness.shift / (2 * same), -1),
        np.where(numbers & enough, 1.0, _NOT_AT_ALL),
        np.where(enough, likeness.overlap + _SAME_LABEL * labels, _NOT_AT_ALL),
        np.where(numbers, 1.0, _NOT_AT_ALL),
    )
    pairs: list[tuple[int, int]] = []
    free, free_others = np.ones(rows, bool), np.ones(columns, bool)
    for worth in rounds:
        at, to = np.flatnonzero(free), np.flatnonzero(free_others)
        for row, column_ in _best(worth[np.ix_(at, to)]):
            free[at[row]] = free_others[to[column_]] = False
            pairs.append((int(at[row]), int(to[column_])))
    return sorted(pairs)


def _best(worth: _F64) -> list[tuple[int, int]]:
    """Return pairs of the largest worth together; none of a negative one."""
    if not (worth >= 0).any():
        return []
    # Zero, not the negative worth: a pair that is none must not cost another one.
    chosen = linear_sum_assignment(np.maximum(worth, 0), maximize=True)
    return [(int(r), int(c)) for r, c in zip(*chosen, strict=True) if worth[r, c] >= 0]


def _largest(values: _F64) -> _F64:
    largest: _F64 = values.max(axis=-1)
    return largest
