"""A made set under names that formats find hard, with boxes between the pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from percept.datasets.labelling.labelled_set import ImageBoxes, LabelledSet

__all__ = ["HARD_NAMES", "renamed", "with_boxes"]

HARD_NAMES = ("yes", 'a, b: "c" <&>\' # $x ]]>', "車\u2028\x07\t é 😀")


def renamed(labelled: LabelledSet, names: Sequence[str] = HARD_NAMES) -> LabelledSet:
    """Return a set with other names of classes, and boxes moved by parts of a pixel."""
    new = dict(zip(labelled.categories, names, strict=True))
    random = np.random.default_rng(1)

    def changed(boxes: ImageBoxes) -> ImageBoxes:
        moved = boxes.boxes_px.copy()
        moved[:2] += random.uniform(-0.5, 0.5, moved[:2].shape)
        labels = tuple(new[label] for label in boxes.labels)
        return replace(boxes, labels=labels, boxes_px=moved)

    boxes = [changed(frame.boxes) for _, frame in labelled.frames()]
    return replace(with_boxes(labelled, boxes), categories=tuple(names), name='näme "<&>"\x01')


def with_boxes(labelled: LabelledSet, boxes: Sequence[ImageBoxes]) -> LabelledSet:
    """Return a set with other boxes: for each image in the order of `frames()` its new ones."""
    left = iter(boxes)
    keyframes = tuple(
        replace(one, frames=tuple(replace(f, boxes=next(left)) for f in one.frames))
        for one in labelled.keyframes
    )
    return replace(labelled, keyframes=keyframes)
