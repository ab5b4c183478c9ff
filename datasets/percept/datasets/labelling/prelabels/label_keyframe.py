"""Boxes to begin from: what networks and tracks found, made into one box for one object.

Each image of a keyframe has the boxes of one or several networks, and the keyframe has 3D boxes.
The networks' boxes of one object become one; 3D boxes are moved to where the objects are when
the image is taken, projected, and matched one to one; and those that no network saw become boxes
of the source `lidar`. What a class is called decides everywhere, never its number.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from percept.datasets.labelling.labelled_set import NO_TRACK, ImageBoxes, SolidBoxes
from percept.datasets.labelling.prelabels.categories import UNKNOWN
from percept.datasets.labelling.prelabels.config import PreLabelConfig, Thresholds
from percept.datasets.labelling.prelabels.linked_view import (
    ImageView,
    LinkedView,
    accepted_solids,
    link_view,
    solid_rows,
)
from percept.datasets.labelling.prelabels.network_boxes import SeenBoxes
from percept.datasets.labelling.prelabels.solid_matches import LinkConfig

__all__ = [
    "LIDAR",
    "ImageView",
    "KeyframeLabels",
    "LinkConfig",
    "PreLabelConfig",
    "Thresholds",
    "label_keyframe",
    "link",
]

LIDAR = "lidar"
"""Source of a 2D box that is a projected 3D box."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class KeyframeLabels:
    """The pre-labels of a keyframe.

    Attributes:
        images: Of each image, in their order.
        solids: The 3D boxes.
        dropped: What was left out, by reason, with a count.
    """

    images: tuple[ImageBoxes, ...]
    solids: SolidBoxes
    dropped: Mapping[str, int] = field(default_factory=dict)


def label_keyframe(
    views: Sequence[ImageView],
    solids: SolidBoxes,
    config: PreLabelConfig,
    *,
    first_box: int = 1,
    first_solid: int = 1,
) -> KeyframeLabels:
    """Make the pre-labels of a keyframe.

    A 3D box of unknown class takes the class of the 2D box that shows it; those that no image
    names are left out.

    Args:
        views: Its images.
        solids: What was found in space, at the keyframe's time, in the base frame.
        config: Settings.
        first_box: Id of the first 2D box; the others follow one by one.
        first_solid: The same of the 3D boxes.
    """
    dropped: Counter[str] = Counter()
    accepted = accepted_solids(solids, config, dropped)
    linked = [_image_boxes(link_view(view, accepted, config, dropped), accepted) for view in views]
    named = _named(accepted, linked, dropped)
    new_ids = {old: first_solid + row for row, old in enumerate(named.ids.tolist())}
    images = []
    for boxes in linked:
        ids = np.arange(first_box, first_box + len(boxes), dtype=np.int64)
        numbers = np.array([new_ids.get(old, 0) for old in boxes.solids.tolist()], dtype=np.int64)
        images.append(replace(boxes, ids=ids, solids=numbers))
        first_box += len(boxes)
    return KeyframeLabels(
        images=tuple(images),
        solids=replace(named, ids=np.array(list(new_ids.values()), dtype=np.int64)),
        dropped={reason: count for reason, count in dropped.items() if count},
    )


def link(
    view: ImageView, solids: SolidBoxes, config: PreLabelConfig, *, first_box: int = 1
) -> ImageBoxes:
    """Make the pre-labels of one image.

    Args:
        view: The image.
        solids: 3D boxes in the base frame; of unknown class too, which may take that of a 2D box.
        config: Settings.
        first_box: Id of the first box; the others follow one by one.
    """
    accepted = accepted_solids(solids, config, Counter())
    boxes = _image_boxes(link_view(view, accepted, config, Counter()), accepted)
    return replace(boxes, ids=np.arange(first_box, first_box + len(boxes), dtype=np.int64))


def _image_boxes(linked: LinkedView, solids: SolidBoxes) -> ImageBoxes:
    """Return the boxes of an image with what is known of the 3D box of each."""
    seen, rows = linked.seen, linked.matches
    if linked.projected is not None:
        extra = SeenBoxes(
            linked.projected.boxes_px[linked.alone],
            tuple(solids.labels[row] for row in linked.alone),
            solids.confidences[linked.alone],
            (LIDAR,) * len(linked.alone),
        )
        seen, rows = SeenBoxes.joined([seen, extra]), np.concatenate([rows, linked.alone])
    solid = rows >= 0
    of = rows[solid]
    unknown = np.full(len(seen), np.nan)
    truncated, occluded = unknown.copy(), unknown.copy()
    if linked.projected is not None:
        truncated[solid] = linked.projected.truncated[of]
        occluded[solid] = linked.projected.occluded[of]
    tracks = np.full(len(seen), NO_TRACK, dtype=np.int64)
    numbers = np.zeros(len(seen), dtype=np.int64)
    tracks[solid], numbers[solid] = solids.track_ids[of], solids.ids[of]
    return ImageBoxes(
        ids=np.zeros(len(seen), np.int64),
        boxes_px=seen.boxes_px,
        labels=seen.labels,
        confidences=seen.confidences,
        sources=seen.sources,
        track_ids=tracks,
        solids=numbers,
        truncated=truncated,
        occluded=occluded,
    )


def _named(solids: SolidBoxes, images: Sequence[ImageBoxes], dropped: Counter[str]) -> SolidBoxes:
    """Return the 3D boxes with the classes that images give to those of unknown class."""
    said: dict[int, tuple[float, str]] = {}
    for boxes in images:
        for row, number in enumerate(boxes.solids.tolist()):
            if number:
                vote = (float(boxes.confidences[row]), boxes.labels[row])
                said[number] = max(said.get(number, vote), vote)
    labels = [
        said[number][1] if label == UNKNOWN and number in said else label
        for number, label in zip(solids.ids.tolist(), solids.labels, strict=True)
    ]
    kept = [row for row, label in enumerate(labels) if label != UNKNOWN]
    dropped["3D boxes of unknown class that no image names"] += len(solids) - len(kept)
    return solid_rows(solids, kept, [labels[row] for row in kept])
