"""Two labellings of the same images, box by box: what people changed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from percept.core.errors import InputError
from percept.core.settings import Settings
from percept.datasets.labelling.corrections.box_pairing import (
    BoxColumn,
    Likeness,
    ids_agree,
    image_likeness,
    pair_boxes,
    solid_likeness,
)
from percept.datasets.labelling.corrections.diff_figures import (
    BoxChange,
    Change,
    ClassFigures,
    figures_of,
)
from percept.datasets.labelling.labelled_set import (
    ImageBoxes,
    Keyframe,
    LabelledFrame,
    LabelledSet,
)

__all__ = [
    "DiffConfig",
    "ImageDiff",
    "MomentDiff",
    "SetDiff",
    "compare_sets",
]

_LEAST_OVERLAP = 0.3
_ONLY = "images that only {} has"
_TWICE = "images of {} with the drive, camera and time of another"
_RENUMBERED = "both number their boxes differently: they were paired by place alone"


class DiffConfig(Settings):
    """When boxes count as the same.

    Attributes:
        same_px: Sides that moved less than this did not move.
        same_m: The same for 3D boxes: centre, size, and ends of the box.
        iou: From this overlap a box of A with the class of its box of B counts as right in
            precision and recall; that of a 3D box is seen from above.
    """

    same_px: float = Field(default=0.5, gt=0, allow_inf_nan=False)
    same_m: float = Field(default=0.05, gt=0, allow_inf_nan=False)
    iou: float = Field(default=0.5, gt=0, le=1)


@dataclass(frozen=True, slots=True, eq=False)
class ImageDiff:
    """An image that both have, with its 2D boxes."""

    drive: str
    a: LabelledFrame
    b: LabelledFrame
    changes: tuple[BoxChange, ...]


@dataclass(frozen=True, slots=True, eq=False)
class MomentDiff:
    """A keyframe that both have, with its 3D boxes."""

    a: Keyframe
    b: Keyframe
    changes: tuple[BoxChange, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SetDiff:
    """All that differs.

    Attributes:
        images: Images that both have, in the order of A.
        moments: Keyframes that both have, in that order.
        by_class: Figures of 2D boxes by class, in the order of A's classes and then B's.
        solids_by_class: The same of 3D boxes.
        total: Of all 2D boxes.
        solids_total: Of all 3D boxes.
        dropped: What was not compared, counted by reason.
        notes: What else should be known.
    """

    images: tuple[ImageDiff, ...]
    moments: tuple[MomentDiff, ...]
    by_class: Mapping[str, ClassFigures]
    solids_by_class: Mapping[str, ClassFigures]
    total: ClassFigures
    solids_total: ClassFigures
    dropped: Mapping[str, int]
    notes: tuple[str, ...]

    @property
    def has_solid_changes(self) -> bool:
        """Whether any 3D box differs; most formats cannot bring a change of one back."""
        return self.solids_total.counts.total() > self.solids_total.counts[Change.UNCHANGED]


def compare_sets(a: LabelledSet, b: LabelledSet, config: DiffConfig | None = None) -> SetDiff:
    """Compare two labellings; images are the same where drive, camera and time are.

    Args:
        a: The first, such as what `prepare` wrote.
        b: The second, such as what labellers made of it.
        config: When boxes count as the same.

    Raises:
        InputError: If no image is in both.
    """
    config = config or DiffConfig()
    dropped: Counter[str] = Counter()
    ours, theirs = _images(a, "A", dropped), _images(b, "B", dropped)
    both = [key for key in ours if key in theirs]
    dropped[_ONLY.format("A")] += len(ours) - len(both)
    dropped[_ONLY.format("B")] += len(theirs) - len(both)
    if not both:
        raise InputError(
            "has no image of the other set: drives, cameras and times differ", where=b.folder
        )
    pairs = [(key[0], ours[key], theirs[key]) for key in both]
    by_number = ids_agree(
        {n: (d, f.camera, f.stamp_ns) for d, f, _ in pairs for n in f.boxes.ids.tolist()},
        {n: (d, f.camera, f.stamp_ns) for d, _, f in pairs for n in f.boxes.ids.tolist()},
    )
    images = tuple(
        ImageDiff(
            drive, one, other, _image_changes(one.boxes, other.boxes, config, by_number=by_number)
        )
        for drive, one, other in pairs
    )
    moments = tuple(_moments(a, b, config))
    order = tuple(dict.fromkeys((*a.categories, *b.categories)))
    by_class, total = figures_of(
        ((i.a.boxes.labels, i.b.boxes.labels, i.changes) for i in images), order, config.iou
    )
    solids, solids_total = figures_of(
        ((m.a.solids.labels, m.b.solids.labels, m.changes) for m in moments), order, config.iou
    )
    return SetDiff(
        images=images,
        moments=moments,
        by_class=by_class,
        solids_by_class=solids,
        total=total,
        solids_total=solids_total,
        dropped={reason: number for reason, number in dropped.items() if number},
        notes=() if by_number else (_RENUMBERED,),
    )


_Key = tuple[str, str, int]


def _images(one: LabelledSet, name: str, dropped: Counter[str]) -> dict[_Key, LabelledFrame]:
    found: dict[_Key, LabelledFrame] = {}
    for keyframe, frame in one.frames():
        key = keyframe.drive, frame.camera, frame.stamp_ns
        if key in found:
            dropped[_TWICE.format(name)] += 1
        found.setdefault(key, frame)
    return found


def _moments(a: LabelledSet, b: LabelledSet, config: DiffConfig) -> Iterator[MomentDiff]:
    theirs = {(one.drive, one.stamp_ns): one for one in b.keyframes}
    pairs = [
        (one, theirs[one.drive, one.stamp_ns])
        for one in a.keyframes
        if (one.drive, one.stamp_ns) in theirs
    ]
    by_number = ids_agree(
        {n: (one.drive, one.stamp_ns) for one, _ in pairs for n in one.solids.ids.tolist()},
        {n: (one.drive, one.stamp_ns) for _, one in pairs for n in one.solids.ids.tolist()},
    )
    for one, other in pairs:
        if len(one.solids) or len(other.solids):
            likeness = solid_likeness(one.solids.boxes_m, other.solids.boxes_m)
            ids = one.solids.ids, other.solids.ids
            changes = _changes(
                one.solids.labels,
                other.solids.labels,
                ids,
                likeness,
                config.same_m,
                by_number=by_number,
            )
            yield MomentDiff(one, other, changes)


def _image_changes(
    a: ImageBoxes, b: ImageBoxes, config: DiffConfig, *, by_number: bool
) -> tuple[BoxChange, ...]:
    likeness = image_likeness(a.boxes_px, b.boxes_px)
    return _changes(
        a.labels, b.labels, (a.ids, b.ids), likeness, config.same_px, by_number=by_number
    )


def _changes(
    labels_a: Sequence[str],
    labels_b: Sequence[str],
    ids: tuple[NDArray[np.int64], NDArray[np.int64]],
    likeness: Likeness,
    same: float,
    *,
    by_number: bool,
) -> tuple[BoxChange, ...]:
    """Return pairs in the order of A, then what was removed, then what was added."""
    theirs = ids[1] if by_number else np.zeros_like(ids[1])
    pairs = pair_boxes(
        BoxColumn(labels_a, ids[0]),
        BoxColumn(labels_b, theirs),
        likeness,
        same=same,
        least_overlap=_LEAST_OVERLAP,
    )
    found = [
        BoxChange(
            Change.RELABELLED
            if labels_a[i] != labels_b[j]
            else Change.UNCHANGED
            if likeness.shift[i, j] < same
            else Change.MOVED,
            i, j, float(likeness.iou[i, j]), float(likeness.shift[i, j]),
        )
        for i, j in pairs
    ]  # fmt: skip
    gone = sorted(set(range(len(labels_a))) - {i for i, _ in pairs})
    new = sorted(set(range(len(labels_b))) - {j for _, j in pairs})
    none = float("nan")
    found += [BoxChange(Change.REMOVED, i, None, none, none) for i in gone]
    return (*found, *(BoxChange(Change.ADDED, None, j, none, none) for j in new))
