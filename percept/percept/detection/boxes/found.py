"""Boxes on their way from the network's candidates to detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FoundBoxes"]


@dataclass(frozen=True, slots=True, eq=False)
class FoundBoxes:
    """Boxes of an image, or of a part of it, with numbers for classes.

    Attributes:
        boxes_px: (N, 4) float64 x1, y1, x2, y2.
        class_ids: (N,) int64.
        scores: (N,) float64 in 0..1.
    """

    boxes_px: NDArray[np.float64]
    class_ids: NDArray[np.int64]
    scores: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.scores)

    def select(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> FoundBoxes:
        """Return the boxes of a mask (N,) bool or of indices (M,), in their order."""
        return FoundBoxes(self.boxes_px[keep], self.class_ids[keep], self.scores[keep])

    @classmethod
    def joined(cls, parts: Sequence[FoundBoxes]) -> FoundBoxes:
        """Return the boxes of all parts, one after the other."""
        return cls(
            np.concatenate([part.boxes_px for part in parts]),
            np.concatenate([part.class_ids for part in parts]),
            np.concatenate([part.scores for part in parts]),
        )
