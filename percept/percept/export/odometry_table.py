"""How well each pose is known, as a table: `quality.parquet` of `percept odometry`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa

__all__ = ["POSE_QUALITY", "pose_quality_rows"]

POSE_QUALITY = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("scan_stamp_ns", pa.int64()),
        ("sd_position_m", pa.float64()),
        ("sd_heading_rad", pa.float64()),
        ("points", pa.int64()),
        ("overlap", pa.float64()),
        ("residual_m", pa.float64()),
        ("hold", pa.float64()),
        ("deviation_m", pa.float64()),
        ("failure", pa.string()),
    ]
)
"""Columns of `quality.parquet`: one row a pose, and one a scan for poses by LiDAR.

From `scan_stamp_ns`, the header stamp of the scan, on, columns but the spread are null where the
poses are not by LiDAR. A scan with a text in `failure` has no pose, and no spread.
"""


def pose_quality_rows(values: Mapping[str, Sequence[object]]) -> pa.RecordBatch:
    """Return rows with the schema `POSE_QUALITY`.

    Args:
        values: By name of the column, as many values each; columns that are missing, and
            numbers that are not finite, become null.
    """
    count = len(values["stamp_ns"])
    arrays = []
    for field in POSE_QUALITY:
        column = values.get(field.name, [None] * count)
        filled = [None if isinstance(v, float) and not np.isfinite(v) else v for v in column]
        arrays.append(pa.array(filled, type=field.type))
    return pa.RecordBatch.from_arrays(arrays, schema=POSE_QUALITY)
