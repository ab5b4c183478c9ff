"""Scans that the exports are tried on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from percept.core.results import Detections3D
from percept.core.samples import PointCloud
from percept.lidar.result import ScanResult

_LABELS = ("car", "pedestrian", "unknown")


def _scan(number: int, boxes: int = 3, points: int = 400, sensor: str = "top") -> ScanResult:
    """Return a scan that depends on its number alone, 0.1 s after the one before."""
    rng = np.random.default_rng(number)
    stamp_ns = 1_700_000_000_000_000_000 + number * 100_000_000
    cloud = PointCloud(
        topic=f"/{sensor}/points",
        stamp_ns=stamp_ns,
        log_time_ns=stamp_ns + 7_000_000,
        frame=f"lidar_{sensor}",
        points_xyz=(rng.uniform(-40, 40, (points, 3)) * [1, 1, 0.02]).astype(np.float32),
    )
    detections = Detections3D(
        stamp_ns=stamp_ns,
        sensor=sensor,
        frame_id=f"lidar_{sensor}",
        boxes_m=np.column_stack(
            [
                rng.uniform(-40, 40, (boxes, 2)),
                np.full(boxes, 0.8),
                np.tile([4.2, 1.8, 1.5], (boxes, 1)),
                rng.uniform(-3, 3, boxes),
            ]
        ),
        labels=tuple(_LABELS[i % 3] for i in range(boxes)),
        confidences=rng.uniform(size=boxes),
        mean_intensity=np.where(np.arange(boxes) % 2, np.nan, 12.5),
        points=rng.integers(5, 500, boxes),
    )
    return ScanResult(
        cloud=cloud,
        ground=rng.uniform(size=points) < 0.5,
        cluster_ids=(np.arange(points) % (boxes + 1) - 1).astype(np.int32),
        detections=detections,
        timings_ms={"ground": 4.0, "cluster": 10.0 + number % 5, "boxes": 2.0, "classify": 0.5},
        dropped={"points out of range": number % 3},
    )


@pytest.fixture(scope="session")
def make_scan() -> Callable[..., ScanResult]:
    """Makes scans: `make_scan(number, boxes=3, points=400, sensor="top")`."""
    return _scan
