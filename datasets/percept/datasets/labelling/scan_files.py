"""The file of a keyframe's points: all LiDARs in the base frame, where they were at its time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from percept.core.samples import PointCloud
from percept.core.transform import Transform

__all__ = ["write_scan"]


def write_scan(
    path: Path,
    clouds: Sequence[PointCloud],
    T_base_sensors: Sequence[Transform],
    motions: Sequence[Transform | None],
) -> int:
    """Write scans as rows of float32 x, y, z, intensity; no intensity is 0.

    Each scan is moved as a whole by what the vehicle drove between its time and the keyframe's;
    within a scan points stay where they were measured.

    Args:
        path: The file.
        clouds: Scans in their sensors' frames.
        T_base_sensors: Where each sensor sits.
        motions: For each, `T_base_base_then` from the base frame at its time into that at the
            keyframe's; None where the motion is not known.

    Returns:
        The number of rows.
    """
    parts = []
    for cloud, place, motion in zip(clouds, T_base_sensors, motions, strict=True):
        matrix = place.matrix if motion is None else motion.matrix @ place.matrix
        rows = np.zeros((len(cloud), 4), dtype="<f4")
        rows[:, :3] = cloud.points_xyz @ matrix[:3, :3].T.astype(np.float32) + matrix[:3, 3]
        if cloud.intensity is not None:
            rows[:, 3] = np.nan_to_num(cloud.intensity)
        parts.append(rows)
    joined = np.concatenate(parts) if parts else np.zeros((0, 4), dtype="<f4")
    path.write_bytes(joined.tobytes())
    return len(joined)
