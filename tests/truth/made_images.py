"""Images with boxes that depend on their number alone, for tests of what is made of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from percept.core.results import Detections2D
from percept.core.samples import CameraImage
from percept.detection.result import ImageResult, Positions

__all__ = ["LABELS", "make_image"]

LABELS = ("car", "pedestrian", "deer")


def make_image(
    number: int,
    *,
    camera: str = "front",
    models: Sequence[str] = ("near", "far"),
    boxes: int = 3,
    size: tuple[int, int] = (800, 450),
    failure: str | None = None,
) -> ImageResult:
    """Return image `number`: 0.1 s after the one before, the second model's first box a duplicate.

    Each image's second box has no position; the others rest on a cluster and on a depth image.
    """
    rng = np.random.default_rng(number)
    stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
    if failure is not None:
        return ImageResult(
            frame=number, camera=camera, stamp_ns=stamp_ns, log_time_ns=stamp_ns + 7,
            image=None, failure=failure,
        )  # fmt: skip
    image = CameraImage(
        topic=f"/{camera}/image",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 7,
        frame=f"{camera}_optical",
        pixels=np.full((size[1], size[0], 3), (30, 60, 90), np.uint8),
    )
    return ImageResult(
        frame=number,
        camera=camera,
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 7,
        image=image,
        boxes={model: _boxes(rng, stamp_ns, camera, boxes, size) for model in models},
        primary={
            model: np.arange(boxes) >= (1 if place else 0) for place, model in enumerate(models)
        },
        positions={model: _positions(rng, boxes) for model in models[:1]},
        decode_ms=4.0,
        timings_ms={
            model: {"prepare": 2.0, "network": 20.0 + number % 5, "boxes": 1.0} for model in models
        },
    )


def _boxes(
    rng: np.random.Generator, stamp_ns: int, camera: str, count: int, size: tuple[int, int]
) -> Detections2D:
    corners = rng.uniform(0.1, 0.4, (count, 2)) * size
    return Detections2D(
        stamp_ns=stamp_ns,
        camera=camera,
        boxes_px=np.column_stack([corners, corners + rng.uniform(40, 200, (count, 2))]),
        labels=tuple(LABELS[row % len(LABELS)] for row in range(count)),
        confidences=rng.uniform(0.3, 1.0, count),
    )


def _positions(rng: np.random.Generator, count: int) -> Positions:
    sources = tuple(("cluster", "", "depth")[row % 3] for row in range(count))
    known = np.array([bool(source) for source in sources], dtype=bool)
    points_m = rng.uniform(5, 40, (count, 3))
    range_m = np.linalg.norm(points_m, axis=1)
    return Positions(
        frame_id="base_link",
        points_m=np.where(known[:, None], points_m, np.nan),
        range_m=np.where(known, range_m, np.nan),
        sources=sources,
        points=np.where(known, rng.integers(3, 90, count), 0),
    )
