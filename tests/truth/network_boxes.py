"""What a network on point clouds would make of a labelled KITTI sequence, told by logits.

Beside errors of place (`noisy_boxes`), a published detector on real scans differs from its labels
in what is there: vans and trucks are reported as cars, sitting persons and cyclists as
pedestrians; objects that nobody labelled are reported for as long as they are in sight; hedges
and poles give weak boxes now and then, several of them side by side; regions that nobody
labelled hold objects, too. What is weak is missed: the detector writes what is above a logit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from noisy_boxes import LEVELS, disturbed, joined_boxes, steady_noise
from numpy.typing import NDArray

from percept.core.box_overlap import iou_bev
from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.frames import frame_slices

__all__ = ["LEAST_LOGIT", "network_detections"]

_F64 = NDArray[np.float64]

LEAST_LOGIT = -0.85
"""A probability of 0.3: what PointRCNN writes."""

_SEEN_AS = {
    "Car": (("Car", 0.0),),
    "Van": (("Car", 2.0),),
    "Truck": (("Car", 7.0),),
    "Pedestrian": (("Pedestrian", 5.0),),
    "Person": (("Pedestrian", 7.0),),
    "Person_sitting": (("Pedestrian", 7.0),),
    "Cyclist": (("Cyclist", 1.0), ("Pedestrian", 8.0)),
}
"""The classes that objects are reported as, and how much weaker than a car."""

_NEAR_LOGIT = 11.0
_LOSS_PER_M = 0.10
_HIDDEN_LOSS = (0.0, 1.5, 4.0, 8.0)
_OBJECT_SD, _FRAME_SD = 2.2, 1.7
_NOISE = replace(LEVELS["moderate"], position_m=0.03, size=0.03, yaw_rad=0.03)
_BIAS_M, _BIAS_SIZE = 0.06, 0.04
_DROPPED = 0.01  # whatever the score
_UNLABELLED = 0.06  # objects without a label for each labelled one
_UNLABELLED_LOSS = 5.0
_CLUTTER = 0.5  # places of weak boxes for each labelled object
_CLUTTER_SHOWN = 0.3
_CLUTTER_LOGIT, _CLUTTER_SD = 0.0, 1.0
_LEAST_OVERLAP = 0.1
_FOCAL_PX, _CENTRE_PX, _IMAGE_PX = 721.5, (609.6, 172.9), (1242.0, 375.0)


def network_detections(truth: TrackedBoxes, seed: int) -> TrackedBoxes:
    """Return what a network would report of a sequence, scores as logits; every id is -1.

    Args:
        truth: All labels of the sequence.
        seed: The same seed gives the same boxes.
    """
    rng = np.random.default_rng(seed)
    parts = [
        _reported(truth.labelled(kind), label, loss, rng)
        for kind, words in _SEEN_AS.items()
        for label, loss in words
    ]
    objects = truth.labelled("Car", "Pedestrian", "Cyclist")
    parts += [_unlabelled(objects, rng), _clutter(objects, rng), _unsure_regions(truth, rng)]
    found = parts[0]
    for part in parts[1:]:
        found = joined_boxes(found, part)
    found = found.select((found.scores > LEAST_LOGIT) & (rng.random(len(found)) > _DROPPED))
    return found.select(_best_of_place(found))


def _best_of_place(found: TrackedBoxes) -> NDArray[np.bool_]:
    """Return which boxes no stronger one of their class overlaps."""
    best = np.ones(len(found), dtype=bool)
    labels = np.array(found.labels)
    for rows in frame_slices(found.frames, np.unique(found.frames)):
        ranked = rows[np.argsort(-found.scores[rows], kind="stable")]
        overlap = iou_bev(found.boxes_m[ranked], found.boxes_m[ranked]) > _LEAST_OVERLAP
        overlap &= labels[ranked][:, None] == labels[ranked]
        for k in range(1, len(ranked)):
            best[ranked[k]] = not (overlap[k, :k] & best[ranked[:k]]).any()
    return best


def _reported(
    objects: TrackedBoxes, label: str, loss: float, rng: np.random.Generator
) -> TrackedBoxes:
    """Return the objects with the errors of the detector; the better seen, the smaller."""
    names, numbers = np.unique(objects.ids, return_inverse=True)
    ranges = np.hypot(objects.boxes_m[:, 0], objects.boxes_m[:, 1])
    logits = _NEAR_LOGIT - loss - _loss_of(objects, ranges)
    logits += rng.normal(0.0, _OBJECT_SD, len(names))[numbers]
    logits += steady_noise(objects.ids, 1, rng)[:, 0] * _FRAME_SD
    return replace(
        objects,
        ids=np.full(len(objects), -1, np.int64),
        labels=(label,) * len(objects),
        boxes_m=disturbed(_biased(objects, rng), ranges, _NOISE, rng),
        boxes_px=objects.boxes_px + rng.normal(0.0, 1.0, (len(objects), 4)),
        scores=logits,
    )


def _biased(objects: TrackedBoxes, rng: np.random.Generator) -> TrackedBoxes:
    """Return the objects with sizes and places off by what does not change with time.

    A network knows the usual size, and puts it to the side that it sees.
    """
    names, numbers = np.unique(objects.ids, return_inverse=True)
    sizes = np.exp(rng.normal(0.0, _BIAS_SIZE, (len(names), 3)))[numbers]
    boxes = objects.boxes_m.copy()
    boxes[:, 3:6] *= sizes
    boxes[:, :2] += rng.normal(0.0, _BIAS_M, (len(names), 2))[numbers]
    boxes[:, 2] += rng.normal(0.0, _BIAS_M, len(names))[numbers]
    return replace(objects, boxes_m=boxes)


def _loss_of(objects: TrackedBoxes, ranges: _F64) -> _F64:
    """Return by how much (R,) distance and what is in front of it weaken an object."""
    hidden = np.array(_HIDDEN_LOSS)[np.clip(objects.occluded, 0, 3)]
    return np.asarray(_LOSS_PER_M * ranges + hidden + 2.0 * np.clip(objects.truncated, 0, 2))


def _unlabelled(objects: TrackedBoxes, rng: np.random.Generator) -> TrackedBoxes:
    """Return objects like others, beside them, that are in no label."""
    copies = [
        _beside(objects, name, rng, rng.uniform(6.0, 12.0))
        for name in np.unique(objects.ids)
        if rng.random() < _UNLABELLED
    ]
    return _all(
        [_reported(o, o.labels[0], _UNLABELLED_LOSS, rng) for o in copies if len(o)], objects
    )


def _clutter(objects: TrackedBoxes, rng: np.random.Generator) -> TrackedBoxes:
    """Return weak boxes at places that stand still, or move as something else does."""
    parts = []
    for name in np.unique(objects.ids):
        for _ in range(rng.poisson(_CLUTTER)):
            place = _beside(objects, name, rng, rng.uniform(4.0, 20.0))
            for shift in range(rng.integers(1, 4)):
                one = place.select(rng.random(len(place)) < _CLUTTER_SHOWN)
                boxes = one.boxes_m.copy()
                boxes[:, :2] += rng.normal((2.5 * shift, 0.0), 0.3, (len(one), 2))
                boxes[:, 6] += rng.normal(0.0, 0.6, len(one))
                scores = rng.normal(_CLUTTER_LOGIT, _CLUTTER_SD, len(one))
                parts.append(replace(one, boxes_m=boxes, scores=scores))
    return _all(parts, objects)


def _beside(
    objects: TrackedBoxes, name: np.int64, rng: np.random.Generator, apart_m: float
) -> TrackedBoxes:
    """Return one object, moved to a side, where that is in the picture and in front."""
    one = objects.select(objects.ids == name)
    boxes = one.boxes_m.copy()
    boxes[:, 1] += apart_m * rng.choice([-1.0, 1.0])
    boxes[:, 0] += rng.uniform(-3.0, 8.0)
    moved = replace(one, boxes_m=boxes, boxes_px=_in_image(boxes))
    wide = (moved.boxes_px[:, 2] - moved.boxes_px[:, 0] > 5.0) & (boxes[:, 0] > 3.0)
    return moved.select(wide)


def _unsure_regions(truth: TrackedBoxes, rng: np.random.Generator) -> TrackedBoxes:
    """Return boxes of cars in regions without labels, as far away as they are high."""
    regions = truth.labelled("DontCare")
    tall = regions.boxes_px[:, 3] - regions.boxes_px[:, 1]
    regions = regions.select((tall > 8.0) & (rng.random(len(tall)) < 0.4))
    left, top, right, bottom = regions.boxes_px.T
    x = _FOCAL_PX * 1.6 / (bottom - top)
    y = (_CENTRE_PX[0] - (left + right) / 2) / _FOCAL_PX * x
    z = (_CENTRE_PX[1] - (top + bottom) / 2) / _FOCAL_PX * x
    size = np.tile([3.9, 1.6, 1.5, 0.0], (len(x), 1))
    boxes = np.column_stack([x, y, z, size]) + rng.normal(0.0, 0.2, (len(x), 7))
    return replace(
        regions,
        labels=("Car",) * len(x),
        boxes_m=boxes,
        scores=rng.normal(1.0, 1.5, len(x)),
    ).select(x < 75.0)


def _in_image(boxes_m: _F64) -> _F64:
    """Return the boxes (R, 4) in KITTI's image of boxes in the level frame of its camera."""
    x = np.maximum(boxes_m[:, 0], 1.0)
    half = np.hypot(boxes_m[:, 3], boxes_m[:, 4]) / 2
    left = _CENTRE_PX[0] - _FOCAL_PX * (boxes_m[:, 1] + half) / x
    right = _CENTRE_PX[0] - _FOCAL_PX * (boxes_m[:, 1] - half) / x
    top = _CENTRE_PX[1] - _FOCAL_PX * (boxes_m[:, 2] + boxes_m[:, 5] / 2) / x
    bottom = _CENTRE_PX[1] - _FOCAL_PX * (boxes_m[:, 2] - boxes_m[:, 5] / 2) / x
    width, height = _IMAGE_PX
    return np.clip(np.column_stack([left, top, right, bottom]), 0.0, [width, height] * 2)


def _all(parts: list[TrackedBoxes], like: TrackedBoxes) -> TrackedBoxes:
    found = like.select(np.zeros(len(like), dtype=bool))
    for part in parts:
        found = joined_boxes(found, part)
    return found
