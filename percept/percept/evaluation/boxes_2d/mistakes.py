"""What goes wrong: classes taken for each other, kinds of false detections, the worst images.

The kinds follow TIDE (Bolya et al. 2020, "TIDE: A General Toolbox for Identifying Object
Detection Errors"), section 2.2, with its lower overlap of 0.1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.evaluation.boxes_2d.result import ImageMistakes
from percept.evaluation.boxes_2d.tables import Compared, TruthTable

__all__ = ["Mistakes", "box_iou", "find_mistakes"]

_TOUCHES_IOU = 0.1
_WORST_IMAGES = 12
_F64 = NDArray[np.float64]
_Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Mistakes:
    """The mistakes at one threshold; see `BoxScores` for the parts."""

    confusions: tuple[tuple[str, str, int], ...]
    kinds: dict[str, int]
    worst: tuple[ImageMistakes, ...]


def find_mistakes(compared: Compared, *, names: Sequence[str], classes: Sequence[str]) -> Mistakes:
    """Look at every detection that counts and is no object.

    Args:
        compared: Labels and detections.
        names: Of the images.
        classes: Their names.
    """
    truth, found = compared.truth, compared.found
    hit = np.zeros(len(truth.label), dtype=bool)
    hit[compared.matches.truth[compared.made & compared.hit]] = True
    false = np.flatnonzero(compared.made & ~compared.hit)
    false = false[np.argsort(-found.score[false], kind="stable")]
    confusions, kinds = _kinds(compared, false, hit)
    ranked = sorted(confusions.items(), key=lambda item: (-item[1], item[0]))
    return Mistakes(
        confusions=tuple((classes[a], classes[b], n) for (a, b), n in ranked),
        kinds=dict(kinds),
        worst=_worst(
            truth.image[truth.counted], truth.image[truth.counted & ~hit], found.image[false], names
        ),
    )


def _worst(
    objects: _Int, missed: _Int, false: _Int, names: Sequence[str]
) -> tuple[ImageMistakes, ...]:
    """Return the images with the most mistakes, from the image of each object and mistake."""
    wanted, lost, extra = (np.bincount(i, minlength=len(names)) for i in (objects, missed, false))
    order = np.argsort(-(lost + extra), kind="stable")[:_WORST_IMAGES]
    return tuple(
        ImageMistakes(names[k], int(wanted[k]), int(lost[k]), int(extra[k]))
        for k in order
        if lost[k] + extra[k]
    )


def _kinds(
    compared: Compared, false: NDArray[np.intp], hit: NDArray[np.bool_]
) -> tuple[Counter[tuple[int, int]], Counter[str]]:
    """Say of each false detection, the most confident first, what it is instead.

    An object is taken for one other class only; further detections on it are something else.
    """
    truth, found = compared.truth, compared.found
    confusions: Counter[tuple[int, int]] = Counter()
    kinds: Counter[str] = Counter()
    taken = hit.copy()
    by_image = _rows_by_image(truth)
    for row in false:
        near = by_image.get(int(found.image[row]), np.zeros(0, np.intp))
        overlaps = box_iou(found.boxes_px[row], truth.boxes_px[near])
        same = truth.label[near] == found.label[row]
        other = np.where(~same & ~taken[near], overlaps, 0.0)
        if len(near) and other.max() >= compared.iou:
            place = near[np.argmax(other)]
            taken[place] = True
            confusions[int(truth.label[place]), int(found.label[row])] += 1
            kinds["object of another class"] += 1
        elif (overlaps[same] >= compared.iou).any():
            kinds["second box on an object"] += 1
        elif (overlaps[same] >= _TOUCHES_IOU).any():
            kinds["object, but badly placed"] += 1
        else:
            kinds["nothing that is labelled"] += 1
    return confusions, kinds


def _rows_by_image(truth: TruthTable) -> dict[int, NDArray[np.intp]]:
    rows = np.flatnonzero(truth.counted)
    rows = rows[np.argsort(truth.image[rows], kind="stable")]
    images, starts = np.unique(truth.image[rows], return_index=True)
    parts = np.split(rows, starts[1:]) if len(rows) else []
    return {int(image): part for image, part in zip(images, parts, strict=True)}


def box_iou(box_px: _F64, boxes_px: _F64) -> _F64:
    """Return the overlap (N,) of a box (4,) with boxes (N, 4): intersection over union."""
    corners = np.minimum(box_px[2:], boxes_px[:, 2:]) - np.maximum(box_px[:2], boxes_px[:, :2])
    shared = np.prod(np.maximum(corners, 0.0), axis=1)
    areas = np.prod(boxes_px[:, 2:] - boxes_px[:, :2], axis=1)
    union = np.prod(box_px[2:] - box_px[:2]) + areas - shared
    overlap: _F64 = np.divide(shared, union, out=np.zeros(len(boxes_px)), where=union > 0)
    return overlap
