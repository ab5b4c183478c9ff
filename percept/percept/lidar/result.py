"""What the LiDAR pipeline says about one scan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Detections3D
from percept.core.samples import PointCloud

__all__ = ["ScanResult"]


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """Boxes of one scan, and what every point was taken for.

    Attributes:
        cloud: The points that were judged, in the frame of the boxes.
        ground: (N,) bool, True where a point is ground.
        cluster_ids: (N,) int32; k is the cluster of detection row k, -1 is none.
        detections: The boxes, in the cloud's frame.
        timings_ms: Milliseconds by stage: `ground`, `cluster`, `boxes`, `classify`.
        dropped: What was left out, by reason, with a count.
    """

    cloud: PointCloud
    ground: NDArray[np.bool_]
    cluster_ids: NDArray[np.int32]
    detections: Detections3D
    timings_ms: Mapping[str, float]
    dropped: Mapping[str, int]
