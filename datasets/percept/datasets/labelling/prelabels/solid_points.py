"""How many points of a scan are in each 3D box."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from percept.datasets.labelling.labelled_set import SolidBoxes

__all__ = ["points_in_boxes", "with_points"]


def with_points(solids: SolidBoxes, scan: Path) -> SolidBoxes:
    """Return the boxes of a keyframe with the points of its scan counted where nobody did.

    Args:
        solids: The boxes.
        scan: Rows of float32 x, y, z, intensity in the same frame, as `KeyScan.file`.

    Raises:
        OSError: If the file cannot be read.
    """
    unknown = solids.points < 0
    if not unknown.any():
        return solids
    rows = np.fromfile(scan, dtype="<f4").reshape(-1, 4)
    points = solids.points.copy()
    points[unknown] = points_in_boxes(rows[:, :3], solids.boxes_m[unknown])
    return replace(solids, points=points)


def points_in_boxes(
    points_m: NDArray[np.floating], boxes_m: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Count points in boxes, their surfaces included; a point in two boxes counts in both.

    Args:
        points_m: (P, 3) in the frame of the boxes, metres.
        boxes_m: (N, 7) as in `SolidBoxes`.

    Returns:
        (N,) numbers of points.
    """
    counts = np.zeros(len(boxes_m), dtype=np.int64)
    order = np.argsort(points_m[:, 0])
    points = points_m[order]
    for row, (x, y, z, length, width, height, yaw) in enumerate(boxes_m.tolist()):
        reach = float(np.hypot(length, width)) / 2
        low, high = np.searchsorted(points[:, 0], [x - reach, x + reach])
        near = points[low:high].astype(np.float64) - [x, y, z]
        near = near[(np.abs(near[:, 1]) <= reach) & (np.abs(near[:, 2]) <= height / 2)]
        cos, sin = np.cos(yaw), np.sin(yaw)
        along, across = cos * near[:, 0] + sin * near[:, 1], cos * near[:, 1] - sin * near[:, 0]
        counts[row] = np.count_nonzero(
            (np.abs(along) <= length / 2) & (np.abs(across) <= width / 2)
        )
    return counts
