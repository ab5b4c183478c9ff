"""2D boxes on images as people label them, or as a detector's files give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from percept.core.errors import GeometryError

__all__ = ["ANY_LABEL", "LabelSet", "LabelledImage"]

ANY_LABEL = "*"
"""Label of an ignored region in which no detection of whatever class counts."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """The boxes of one image; `LabelledImage.of` fills in what is not known.

    Attributes:
        name: Of the image, as its file gives it; `camera/stamp_ns` for images of a log.
        image_size: (width, height) in pixels, or None where it is not known.
        boxes_px: (N, 4) float64 x1, y1, x2, y2.
        labels: N class names.
        confidences: (N,) float64 in 0..1, or None where the source has none.
        ignore: (N,) bool: regions, such as a crowd, in which detections of the label do not
            count; of all labels where it is `ANY_LABEL`.
        range_m: (N,) float64 distance of the object; NaN where unknown.
        visible: (N,) float64 share of the object that can be seen, 0..1; NaN where unknown.
        box_ids: (N,) int64 number that the source gives each box, from 1; 0 where it has none.
        track_ids: (N,) int64 number of the object over several images; -1 where it has none.

    Raises:
        GeometryError: If the columns do not have one length, or a box is not finite or has its
            corners the wrong way round.
    """

    name: str
    image_size: tuple[int, int] | None
    boxes_px: NDArray[np.float64]
    labels: tuple[str, ...]
    confidences: NDArray[np.float64] | None
    ignore: NDArray[np.bool_]
    range_m: NDArray[np.float64]
    visible: NDArray[np.float64]
    box_ids: NDArray[np.int64]
    track_ids: NDArray[np.int64]

    def __post_init__(self) -> None:
        count = len(self.labels)
        columns: list[NDArray[np.generic]] = [self.ignore, self.range_m, self.visible]
        columns += [self.box_ids, self.track_ids]
        columns += [] if self.confidences is None else [self.confidences]
        shapes = [column.shape for column in columns]
        if self.boxes_px.shape != (count, 4) or any(shape != (count,) for shape in shapes):
            raise GeometryError(
                f"{count} labels need ({count}, 4) boxes and ({count},) columns, got "
                f"{[self.boxes_px.shape, *shapes]}",
                where=self.name,
            )
        turned = self.boxes_px[:, 2:] < self.boxes_px[:, :2]
        if not np.isfinite(self.boxes_px).all() or turned.any():
            raise GeometryError("a box is not finite or turned inside out", where=self.name)

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def of(
        cls,
        name: str,
        boxes_px: ArrayLike = (),
        labels: Sequence[str] = (),
        confidences: ArrayLike | None = None,
        *,
        image_size: tuple[int, int] | None = None,
        ignore: ArrayLike | None = None,
        range_m: ArrayLike | None = None,
        visible: ArrayLike | None = None,
        box_ids: ArrayLike | None = None,
        track_ids: ArrayLike | None = None,
    ) -> Self:
        """Return an image with these boxes; what is left out is unknown, and no box is ignored."""
        count = len(labels)
        unknown = np.full(count, np.nan)
        return cls(
            name,
            image_size,
            np.asarray(boxes_px, dtype=np.float64).reshape(-1, 4),
            tuple(labels),
            None if confidences is None else np.asarray(confidences, dtype=np.float64),
            np.zeros(count, bool) if ignore is None else np.asarray(ignore, dtype=bool),
            unknown if range_m is None else np.asarray(range_m, dtype=np.float64),
            unknown if visible is None else np.asarray(visible, dtype=np.float64),
            np.zeros(count, np.int64) if box_ids is None else np.asarray(box_ids, np.int64),
            np.full(count, -1) if track_ids is None else np.asarray(track_ids, np.int64),
        )


@dataclass(frozen=True, slots=True, eq=False)
class LabelSet:
    """The labels, or the detections, of a set of images.

    Attributes:
        images: Each image once, in the order of the source.
        complete: Whether every image that was looked at is among them; a set that lists only
            images with boxes is not.
        categories: All class names that the source knows, by its own number; empty where it has
            no such list, so that a class is known by its boxes only.
        image_ids: Name of each image by the number that the source gives it, or empty.
        dropped: What could not be used, counted by reason.
        notes: What else should be known about the source.
        files: The files that were read.
    """

    images: tuple[LabelledImage, ...]
    complete: bool = True
    categories: Mapping[int, str] = field(default_factory=dict)
    image_ids: Mapping[int, str] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def class_names(self) -> tuple[str, ...]:
        """The classes that the source lists, and those of its boxes, in that order."""
        names = dict.fromkeys(self.categories.values())
        for image in self.images:
            names |= dict.fromkeys(image.labels)
        names.pop(ANY_LABEL, None)
        return tuple(names)
