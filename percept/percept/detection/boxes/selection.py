"""Which of the boxes that a network puts out become detections."""

from __future__ import annotations

import difflib
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import UsageError
from percept.detection.boxes.found import FoundBoxes
from percept.detection.boxes.nms import suppress_duplicates
from percept.detection.yolo_config import YoloConfig

__all__ = ["Selection"]


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The thresholds of a network's settings, by class number.

    Attributes:
        scores: (classes,) least confidence of each class.
        wanted: (classes,) whether each class is kept.
        iou: Above which two boxes of a class are one object.
        min_size_px: Least width and height.
        max_boxes: Most boxes of an image.
    """

    scores: NDArray[np.float64]
    wanted: NDArray[np.bool_]
    iou: float
    min_size_px: float
    max_boxes: int

    @classmethod
    def of(cls, config: YoloConfig, class_names: tuple[str, ...], where: object) -> Selection:
        """Resolve the names in the settings.

        Raises:
            UsageError: If a class is named that the network does not know.
        """
        kept = config.classes
        for name in [*config.class_scores, *(kept or ())]:
            _check_name(name, class_names, where)
        scores = np.array([config.class_scores.get(name, config.score) for name in class_names])
        wanted = np.array([kept is None or name in kept for name in class_names])
        return cls(scores, wanted, config.iou, config.min_size_px, config.max_boxes)

    @property
    def lowest_score(self) -> float:
        """Confidence below which no box of any class is kept."""
        return float(self.scores.min())

    def choose(
        self, found: FoundBoxes, image_size: tuple[int, int], *, duplicates: bool
    ) -> tuple[FoundBoxes, Counter[str]]:
        """Return the boxes that stay, most confident first, and count those left out by reason.

        Boxes below their class's confidence and duplicates are no objects, and are not counted.

        Args:
            found: Boxes in the image.
            image_size: (width, height), pixels.
            duplicates: Whether one object may have several boxes.
        """
        found = found.select(found.scores >= self.scores[found.class_ids])
        if duplicates:
            columns = (found.boxes_px, found.class_ids, found.scores)
            found = found.select(suppress_duplicates(*columns, self.iou))
        else:
            found = found.select(np.argsort(-found.scores, kind="stable"))
        stays, dropped = np.ones(len(found), np.bool_), Counter[str]()
        for reason, rule in self._rules(found, image_size).items():
            dropped[reason] += int(np.count_nonzero(stays & ~rule))
            stays &= rule
        left = np.flatnonzero(stays)
        most = f"boxes after the {self.max_boxes} most confident of an image"
        dropped[most] += len(left[self.max_boxes :])
        return found.select(left[: self.max_boxes]), +dropped

    def _rules(
        self, found: FoundBoxes, image_size: tuple[int, int]
    ) -> dict[str, NDArray[np.bool_]]:
        """Return which boxes each rule lets stay."""
        low, high = found.boxes_px[:, :2], found.boxes_px[:, 2:]
        sizes = (high - low).min(axis=1)
        inside = np.minimum(high, image_size - low).min(axis=1)
        return {
            "boxes without an area": sizes > 0,
            "boxes outside the image": inside > 0,
            "boxes of classes that were not asked for": self.wanted[found.class_ids],
            f"boxes below {self.min_size_px:g} px": sizes >= self.min_size_px,
        }


def _check_name(name: str, class_names: tuple[str, ...], where: object) -> None:
    if name in class_names:
        return
    near = difflib.get_close_matches(name, class_names, n=1, cutoff=0.0)
    raise UsageError(
        f"the network has no class '{name}'", where=where, remedy=f"The nearest is '{near[0]}'"
    )
