"""What the networks say about one image, and where in space that is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.core.samples import CameraImage

__all__ = ["ImageResult", "Positions"]


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """Where the objects in N boxes of an image are.

    Attributes:
        frame_id: Frame of the points.
        points_m: (N, 3) float64 middle of what was measured of each object; NaN where unknown.
        range_m: (N,) float64 distance from the camera; NaN where unknown.
        sources: What each rests on: `cluster`, `depth`, or empty where unknown.
        points: (N,) int64 number of LiDAR points or depth pixels that each rests on.
    """

    frame_id: str
    points_m: NDArray[np.float64]
    range_m: NDArray[np.float64]
    sources: tuple[str, ...]
    points: NDArray[np.int64]

    @classmethod
    def unknown(cls, count: int, frame_id: str = "") -> Positions:
        """Return positions of which none is known."""
        return cls(
            frame_id,
            np.full((count, 3), np.nan),
            np.full(count, np.nan),
            ("",) * count,
            np.zeros(count, np.int64),
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageResult:
    """One image of a log, after every model whose turn it was.

    Attributes:
        frame: Number of the image in the run, over all cameras, from 0.
        camera: Name of the camera.
        stamp_ns: Time of the image.
        log_time_ns: Time of recording.
        image: The image; None where it cannot be decoded.
        boxes: What each model found, by its name, in pixels of the recorded image.
        primary: By model (N,) bool: False where another model found the same object in this
            image with more confidence.
        light_states: By model and box, what a traffic light shows whose class name does not tell:
            `red`, `yellow`, `green`, `off`, or empty. A model without such boxes is not in it.
        positions: By model, where the boxes are in space; empty where no sensor tells.
        decode_ms: Milliseconds for decoding the image.
        timings_ms: By model, milliseconds by stage: `prepare`, `network`, `boxes`.
        failure: Why the image cannot be used, or None.
    """

    frame: int
    camera: str
    stamp_ns: int
    log_time_ns: int
    image: CameraImage | None
    boxes: Mapping[str, Detections2D] = field(default_factory=dict)
    primary: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    light_states: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    positions: Mapping[str, Positions] = field(default_factory=dict)
    decode_ms: float = 0.0
    timings_ms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    failure: str | None = None
