"""The boxes of several networks in one image: one box for one object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.datasets.labelling.prelabels.categories import kind_of

__all__ = ["SeenBoxes", "join_networks", "overlaps", "shares_inside"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SeenBoxes:
    """Boxes in one image with the names of who found them.

    Attributes:
        boxes_px: (N, 4) float64 x1, y1, x2, y2.
        labels: N categories.
        confidences: (N,) float64 in 0..1.
        sources: N names of networks.
    """

    boxes_px: _F64
    labels: tuple[str, ...]
    confidences: _F64
    sources: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.labels)

    def select(self, rows: NDArray[np.intp]) -> SeenBoxes:
        """Return the boxes of indices (M,), in their order."""
        return SeenBoxes(
            self.boxes_px[rows],
            tuple(self.labels[row] for row in rows),
            self.confidences[rows],
            tuple(self.sources[row] for row in rows),
        )

    @classmethod
    def joined(cls, parts: Sequence[SeenBoxes]) -> SeenBoxes:
        """Return the boxes of all parts, one after the other."""
        return cls(
            np.concatenate([part.boxes_px for part in parts]),
            tuple(label for part in parts for label in part.labels),
            np.concatenate([part.confidences for part in parts]),
            tuple(source for part in parts for source in part.sources),
        )

    @classmethod
    def of(cls, found: Mapping[str, Detections2D]) -> SeenBoxes:
        """Return the boxes of all networks, one network after the other."""
        return cls(
            np.concatenate([np.zeros((0, 4)), *(one.boxes_px for one in found.values())]),
            tuple(label for one in found.values() for label in one.labels),
            np.concatenate([np.zeros(0), *(one.confidences for one in found.values())]),
            tuple(name for name, one in found.items() for _ in range(len(one))),
        )


def join_networks(seen: SeenBoxes, same_iou: float, any_iou: float) -> NDArray[np.intp]:
    """Return which boxes to keep, rising: the most confident one of each object.

    Boxes of different networks are one object where they are of one kind and overlap enough, or,
    whatever they are called, where they overlap nearly fully. Boxes of one network never
    compete: its own suppression has settled that. Of equals, the first counts.

    Args:
        seen: The boxes.
        same_iou: Intersection over union above which two boxes of one kind are one object.
        any_iou: The same for boxes of different kinds.
    """
    sources, kinds = np.array(seen.sources), np.array([kind_of(one) for one in seen.labels])
    shared = overlaps(seen.boxes_px, seen.boxes_px)
    kept = np.zeros(len(seen), bool)
    for row in np.argsort(-seen.confidences, kind="stable"):
        needed = np.where(kinds == kinds[row], same_iou, any_iou)
        rivals = kept & (sources != sources[row]) & (shared[row] > needed)
        kept[row] = not rivals.any()
    return np.flatnonzero(kept)


def overlaps(boxes_px: _F64, others_px: _F64) -> _F64:
    """Return the intersection over union (N, M) of rectangles (N, 4) and (M, 4)."""
    shared = _shared(boxes_px, others_px)
    return _ratio(shared, _areas(boxes_px)[:, None] + _areas(others_px)[None] - shared)


def shares_inside(boxes_px: _F64, others_px: _F64) -> _F64:
    """Return which share (N, M) of rectangles (N, 4) is inside others (M, 4)."""
    shared = _shared(boxes_px, others_px)
    return _ratio(shared, np.broadcast_to(_areas(boxes_px)[:, None], shared.shape))


def _shared(boxes_px: _F64, others_px: _F64) -> _F64:
    low = np.maximum(boxes_px[:, None, :2], others_px[None, :, :2])
    high = np.minimum(boxes_px[:, None, 2:], others_px[None, :, 2:])
    area: _F64 = np.clip(high - low, 0, None).prod(axis=2)
    return area


def _areas(boxes_px: _F64) -> _F64:
    area: _F64 = (boxes_px[:, 2:] - boxes_px[:, :2]).prod(axis=1)
    return area


def _ratio(part: _F64, whole: _F64) -> _F64:
    ratio: _F64 = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
    return ratio
