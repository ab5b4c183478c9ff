"""A detector that sees images without lens distortion and speaks of the recorded ones."""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.detection.images.undistort import Undistorter
from percept.detection.runner import ImageDetector

__all__ = ["LenslessDetector"]

_NOTHING_THERE = "boxes in which nothing recorded appears"


class LenslessDetector:
    """Takes the lens out of images before a detector sees them; several threads may call it.

    Args:
        detector: The detector.
        undistorter: The lens of the camera whose images come.

    Attributes:
        dropped: Boxes that were left out, by reason.
    """

    def __init__(self, detector: ImageDetector, undistorter: Undistorter) -> None:
        self._detector = detector
        self._undistorter = undistorter
        self._lock = threading.Lock()
        self.dropped = Counter[str]()

    @property
    def seen_share(self) -> float:
        """Share of the recorded pixels that the detector sees."""
        return self._undistorter.seen_share

    def detect_one(self, pixels: NDArray[Any]) -> tuple[Detections2D, dict[str, float]]:
        """Find the objects of one image.

        Args:
            pixels: (H, W) or (H, W, 3) as recorded.

        Returns:
            The boxes in pixels of the recorded image, and milliseconds by stage; `prepare` has
            the time for the lens in it.

        Raises:
            GeometryError: If the image has not the size that the camera was calibrated for.
        """
        begun_s = time.perf_counter()
        straight = self._undistorter.image(pixels)
        lens_ms = 1e3 * (time.perf_counter() - begun_s)
        found, timings_ms = self._detector.detect_one(straight)
        timings_ms = {**timings_ms, "prepare": timings_ms.get("prepare", 0.0) + lens_ms}
        return self._recorded(found), timings_ms

    def _recorded(self, found: Detections2D) -> Detections2D:
        boxes_px = self._undistorter.to_recorded(found.boxes_px)
        rows = np.flatnonzero(np.isfinite(boxes_px).all(axis=1))
        if len(rows) < len(found):
            with self._lock:
                self.dropped[_NOTHING_THERE] += len(found) - len(rows)
        labels = tuple(found.labels[row] for row in rows)
        return Detections2D(
            found.stamp_ns, found.camera, boxes_px[rows], labels, found.confidences[rows]
        )
