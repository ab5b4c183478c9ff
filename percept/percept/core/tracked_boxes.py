"""Boxes with identities over a sequence: labels, or what a tracker made of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError

__all__ = ["TrackedBoxes"]

_WIDTHS = {"boxes_px": 4, "boxes_m": 7, "velocities_mps": 2}


def _none() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackedBoxes:
    """All boxes of one sequence, a row each, frame by frame.

    What is not given is NaN, or 0 of the whole numbers.

    Attributes:
        frames: (R,) int64 number, or stamp in ns, of the frame of each box; never falling.
        ids: (R,) int64 identity; one that is negative stands for no identity.
        labels: R class names.
        boxes_px: (R, 4) float64 x1, y1, x2, y2 in the image.
        boxes_m: (R, 7) float64 centre x, y, z, length, width, height in metres, yaw in rad.
        velocities_mps: (R, 2) float64 along x and y.
        scores: (R,) float64 confidence, the higher the better, in whatever unit.
        truncated: (R,) int64 how far the image cuts the object off: 0 not at all.
        occluded: (R,) int64 how far it is hidden: 0 not at all, 1 partly, 2 largely, 3 unknown.

    Raises:
        GeometryError: If the columns do not have one length, or the frames fall.
    """

    frames: NDArray[np.int64]
    ids: NDArray[np.int64]
    labels: tuple[str, ...]
    boxes_px: NDArray[np.float64] = field(default_factory=_none)
    boxes_m: NDArray[np.float64] = field(default_factory=_none)
    velocities_mps: NDArray[np.float64] = field(default_factory=_none)
    scores: NDArray[np.float64] = field(default_factory=_none)
    truncated: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    occluded: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        count = len(self.labels)
        for name, width in _WIDTHS.items():
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.full((count, width), np.nan))
            if getattr(self, name).shape != (count, width):
                raise GeometryError(
                    f"{name} is ({count}, {width}), not {getattr(self, name).shape}"
                )
        if not self.scores.size:
            object.__setattr__(self, "scores", np.full(count, np.nan))
        for name in ("truncated", "occluded"):
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros(count, np.int64))
        columns = (self.frames, self.ids, self.scores, self.truncated, self.occluded)
        if any(column.shape != (count,) for column in columns):
            raise GeometryError(f"columns of {count} boxes: {[c.shape for c in columns]}")
        if (np.diff(self.frames) < 0).any():
            raise GeometryError("the frames of tracked boxes must not fall")

    def __len__(self) -> int:
        return len(self.labels)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> TrackedBoxes:
        """Return the boxes of a mask (R,) bool, or of rising indices (M,)."""
        chosen = np.arange(len(self))[rows]
        return TrackedBoxes(
            frames=self.frames[chosen],
            ids=self.ids[chosen],
            labels=tuple(self.labels[row] for row in chosen),
            boxes_px=self.boxes_px[chosen],
            boxes_m=self.boxes_m[chosen],
            velocities_mps=self.velocities_mps[chosen],
            scores=self.scores[chosen],
            truncated=self.truncated[chosen],
            occluded=self.occluded[chosen],
        )

    def labelled(self, *labels: str) -> TrackedBoxes:
        """Return the boxes of some classes."""
        return self.select(np.array([label in labels for label in self.labels], dtype=np.bool_))
