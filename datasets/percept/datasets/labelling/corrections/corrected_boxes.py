"""What is known of a box beside its place, kept over a correction.

Formats lose numbers, tracks, networks and confidences. A corrected box that is one of the original
ones takes them from there: as it is where nobody touched it, without network and confidence where
a person moved it or gave it another class.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.labels import LabelledImage
from percept.datasets.labelling.corrections.box_pairing import BoxColumn, image_likeness, pair_boxes
from percept.datasets.labelling.labelled_set import NO_TRACK, ImageBoxes

__all__ = ["ROUNDING_PX", "ShownBoxes", "corrected_boxes", "pairs_of"]

_F64 = NDArray[np.float64]

ROUNDING_PX = 0.05
"""A shift below is the rounding of a tool: CVAT and KITTI's tools write two decimals."""

_LEAST_OVERLAP = 0.3
_CUT = "boxes cut at the edge of the image"
_OUTSIDE = "boxes outside of the image"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ShownBoxes:
    """The boxes of an image as a format showed them.

    Attributes:
        boxes: All boxes of the image, in the recorded one.
        rows: (M,) rows of those that the format has.
        boxes_px: (M, 4) where it has them.
        recorded: Brings boxes (K, 4) from there into the recorded image.
        image_size: (width, height).
    """

    boxes: ImageBoxes
    rows: NDArray[np.intp]
    boxes_px: _F64
    recorded: Callable[[_F64], _F64]
    image_size: tuple[int, int]


def pairs_of(shown: ShownBoxes, found: LabelledImage, *, by_number: bool) -> dict[int, int]:
    """Return the row among all boxes of the image, by the row among those that were found.

    Args:
        shown: The image.
        found: What the files say of it.
        by_number: Whether the numbers in the files are those of the set.
    """
    ids = found.box_ids if by_number else np.zeros_like(found.box_ids)
    pairs = pair_boxes(
        BoxColumn([shown.boxes.labels[row] for row in shown.rows], shown.boxes.ids[shown.rows]),
        BoxColumn(found.labels, ids),
        image_likeness(shown.boxes_px, found.boxes_px),
        same=ROUNDING_PX,
        least_overlap=_LEAST_OVERLAP,
    )
    return {theirs: int(shown.rows[ours]) for ours, theirs in pairs}


def corrected_boxes(
    shown: ShownBoxes,
    found: LabelledImage,
    pairs: Mapping[int, int],
    links: Mapping[int, int],
    *,
    numbers: Iterator[int],
    dropped: Counter[str],
) -> ImageBoxes:
    """Return the boxes of an image after a correction.

    Boxes that the format did not show stay as they are, and so do the places of those that nobody
    moved.

    Args:
        shown: The image.
        found: What the files say of it.
        pairs: The row among all boxes of the image by that of what was found.
        links: The number of the 3D box of the same object, where that is a new one, by row found.
        numbers: Gives numbers to boxes that are new.
        dropped: Counts boxes outside of the image and those that reach over its edge.
    """
    places = _places(shown, found, pairs)
    inside, cut = _cut(places, shown.image_size)
    outside = (cut[:, 2:] <= cut[:, :2]).any(axis=1)
    dropped[_CUT] += int((~inside & ~outside).sum())
    dropped[_OUTSIDE] += int(outside.sum())
    rows = []
    for at in np.flatnonzero(~outside).tolist():
        row = _Row.of(shown.boxes, pairs[at]) if at in pairs else _Row.new(next(numbers))
        row.correct(cut[at], found.labels[at], int(found.track_ids[at]))
        row.solid = links.get(at, row.solid)
        rows.append(row)
    hidden = np.setdiff1d(np.arange(len(shown.boxes)), shown.rows)
    rows += [_Row.of(shown.boxes, int(row)) for row in hidden]
    return _as_boxes(rows)


def _places(shown: ShownBoxes, found: LabelledImage, pairs: Mapping[int, int]) -> _F64:
    """Return where the boxes are in the recorded image; sides that nobody moved stay as they are.

    So nothing is lost by what a format rounds, or cuts at the edge of its image.
    """
    place_of = {int(row): box for row, box in zip(shown.rows, shown.boxes_px, strict=True)}
    moves = np.ones((len(found), 4), bool)
    before = np.zeros((len(found), 4))
    for at, row in pairs.items():
        moves[at] = np.abs(place_of[row] - found.boxes_px[at]) >= ROUNDING_PX
        before[at] = shown.boxes.boxes_px[row]
    moved = moves.any(axis=1)
    places = before.copy()
    places[moved] = shown.recorded(found.boxes_px[moved])
    return np.where(moves, places, before)


def _cut(boxes_px: _F64, image_size: tuple[int, int]) -> tuple[NDArray[np.bool_], _F64]:
    """Return which boxes are in an image as far as rounding goes, and all of them cut at it."""
    cut = np.clip(boxes_px, 0.0, np.array(image_size * 2, dtype=np.float64))
    inside: NDArray[np.bool_] = np.abs(cut - boxes_px).max(axis=1, initial=0) < ROUNDING_PX
    return inside, cut


@dataclass(slots=True)
class _Row:
    number: int
    box_px: _F64
    label: str
    confidence: float
    source: str
    track: int
    solid: int
    truncated: float
    occluded: float

    @classmethod
    def of(cls, boxes: ImageBoxes, row: int) -> _Row:
        """Return a box as it was."""
        return cls(
            int(boxes.ids[row]), boxes.boxes_px[row], boxes.labels[row],
            float(boxes.confidences[row]), boxes.sources[row], int(boxes.track_ids[row]),
            int(boxes.solids[row]), float(boxes.truncated[row]), float(boxes.occluded[row]),
        )  # fmt: skip

    @classmethod
    def new(cls, number: int) -> _Row:
        """Return a box that nothing is known of."""
        unknown = float("nan")
        return cls(number, np.zeros(4), "", unknown, "", NO_TRACK, 0, unknown, unknown)

    def correct(self, box_px: _F64, label: str, track: int) -> None:
        """Take place, class and track of the files; a person's box has no confidence."""
        if label != self.label or not np.array_equal(box_px, self.box_px):
            self.confidence, self.source = float("nan"), ""
        self.label, self.box_px = label, box_px
        self.track = self.track if track == NO_TRACK else track


def _as_boxes(rows: list[_Row]) -> ImageBoxes:
    return ImageBoxes(
        ids=np.array([row.number for row in rows], np.int64),
        boxes_px=np.array([row.box_px for row in rows], np.float64).reshape(-1, 4),
        labels=tuple(row.label for row in rows),
        confidences=np.array([row.confidence for row in rows], np.float64),
        sources=tuple(row.source for row in rows),
        track_ids=np.array([row.track for row in rows], np.int64),
        solids=np.array([row.solid for row in rows], np.int64),
        truncated=np.array([row.truncated for row in rows], np.float64),
        occluded=np.array([row.occluded for row in rows], np.float64),
    )
