"""Signs that a file was not written as it is read, or that both sides do not mean the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from percept.core.labels import LabelledImage
from percept.evaluation.boxes_2d.pairing import ImagePairs
from percept.evaluation.boxes_2d.result import Counts

__all__ = ["doubts_about_boxes", "doubts_about_matches"]

_F64 = NDArray[np.float64]

# Labels of objects at the rim, and networks that do not clip, go a little beyond an image.
_FARTHEST_BEYOND = 0.02
_MOST_BEYOND = 0.02
# Few boxes are larger than they are far from the left and the top, but all that have x2 as width.
_FEWEST_BOXES = 10
_MOST_LARGER = 0.5
_LARGEST_SHARE = 2.0
_LEAST_AGREEMENT = 0.2


def doubts_about_boxes(pairs: ImagePairs) -> list[str]:
    """Say what is strange about the boxes of the labels, and about those of the detections.

    Returns:
        A sentence for each sign: boxes that leave their image, as corners do that are read as a
        corner and a size; sizes that are larger than the corners, which is the same where no
        size of an image is known; and boxes that are shares of an image's size.
    """
    labels, found = [a for a, _ in pairs.images], [b for _, b in pairs.images]
    sizes_px = np.array(
        [a.image_size or b.image_size or (np.inf, np.inf) for a, b in pairs.images], np.float64
    ).reshape(-1, 2)
    sides = (("labels", labels), ("detections", found))
    return [f"{side}: {sign}" for side, images in sides for sign in _signs(images, sizes_px)]


def doubts_about_matches(counts: Counts, confused: int) -> list[str]:
    """Say whether next to nothing agrees, which a detector seldom is the cause of.

    Args:
        counts: Of all classes at the operating threshold.
        confused: Objects that are taken for another class.
    """
    agreeing, detections = counts.hits + confused, counts.detections or 0
    if agreeing < _LEAST_AGREEMENT * min(counts.objects, detections):
        return [
            f"of {detections} detections {agreeing} lie on an object: are images and boxes "
            "numbered and written alike in both?"
        ]
    if confused > counts.hits and confused >= _FEWEST_BOXES:
        return [
            f"of the objects {confused} are taken for another class and {counts.hits} for their "
            "own: do the numbers of classes mean the same in both?"
        ]
    return []


def _signs(images: Sequence[LabelledImage], sizes_px: _F64) -> Iterator[str]:
    counts = [len(image) for image in images]
    if not sum(counts):
        return
    boxes_px = np.concatenate([image.boxes_px for image in images])
    corners_px, far_px = boxes_px[:, :2], boxes_px[:, 2:]
    sides_px = np.repeat(sizes_px, counts, axis=0)
    margin_px = _FARTHEST_BEYOND * sides_px
    beyond = ((corners_px < -margin_px) | (far_px > sides_px + margin_px)).any(axis=1)
    if beyond.sum() > _MOST_BEYOND * len(boxes_px):
        yield (
            f"{beyond.sum()} of {len(boxes_px)} boxes reach beyond their image: COCO's are x y "
            "width height, YOLO's centre and size"
        )
    larger = (far_px - corners_px > corners_px).all(axis=1)[np.isinf(sides_px).all(axis=1)]
    if len(larger) >= _FEWEST_BOXES and larger.mean() > _MOST_LARGER:
        yield "sizes of boxes are like corners: COCO's are x y width height, not x1 y1 x2 y2"
    if np.abs(boxes_px).max() <= _LARGEST_SHARE:
        yield "all boxes are within 2 pixels: are they shares of the image's size?"
