"""The boxes of an image one by one, for formats that write them so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from percept.datasets.labelling.labelled_set import NO_TRACK, ImageBoxes

__all__ = ["ImageBox", "each_box"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageBox:
    """One row of `ImageBoxes`: what is not known there is None here.

    Attributes:
        box_id: Number of the box in the set, from 1; 0 for one that is not in it.
        box_px: x1, y1, x2, y2 in the recorded image.
        label: Class name.
        confidence: 0..1; None where a person drew the box.
        source: The network, or `lidar`; None where a person drew the box.
        track_id: The object's number in its drive.
        solid: Number of the 3D box of the same object.
        truncated: Share outside the image, 0..1.
        occluded: Share hidden by others, 0..1.
    """

    box_id: int
    box_px: tuple[float, float, float, float]
    label: str
    confidence: float | None
    source: str | None
    track_id: int | None
    solid: int | None
    truncated: float | None
    occluded: float | None


def each_box(boxes: ImageBoxes) -> Iterator[ImageBox]:
    """Yield the boxes of an image in their order."""
    columns = zip(
        boxes.ids.tolist(), boxes.boxes_px.tolist(), boxes.labels, boxes.confidences.tolist(),
        boxes.sources, boxes.track_ids.tolist(), boxes.solids.tolist(), boxes.truncated.tolist(),
        boxes.occluded.tolist(), strict=True,
    )  # fmt: skip
    for box_id, (x1, y1, x2, y2), label, sure, source, track, solid, cut, hidden in columns:
        yield ImageBox(
            box_id=box_id,
            box_px=(x1, y1, x2, y2),
            label=label,
            confidence=_known(sure),
            source=source or None,
            track_id=None if track == NO_TRACK else track,
            solid=solid or None,
            truncated=_known(cut),
            occluded=_known(hidden),
        )


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
