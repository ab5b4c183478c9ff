"""What is kept of a frame that is finished: all that tables, overlay and report need of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from percept.core.results import Detections3D
from percept.export.tables import BOX_COLUMNS
from percept.lidar.result import ScanResult

__all__ = ["FinishedFrame", "detections_of", "finished_frame"]


@dataclass(frozen=True, slots=True)
class FinishedFrame:
    """What is kept of a finished frame besides its rows.

    Attributes:
        frame: Number of the frame in the run, from 0.
        sensor: Name of the sensor, or of the group that was merged.
        frame_id: Frame that the boxes are given in.
        stamp_ns: Time of the scan.
        log_time_ns: Time of recording.
        points: Points that were judged.
        ground_points: Points taken for ground.
        timings_ms: Milliseconds by stage.
        dropped: What was left out, by reason, with a count.
    """

    frame: int
    sensor: str
    frame_id: str
    stamp_ns: int
    log_time_ns: int
    points: int = 0
    ground_points: int = 0
    timings_ms: Mapping[str, float] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)


def finished_frame(frame: int, result: ScanResult) -> FinishedFrame:
    """Return what the journal keeps of a scan besides its boxes.

    Args:
        frame: Number of the scan in the run, from 0.
        result: The scan.
    """
    return FinishedFrame(
        frame=frame,
        sensor=result.detections.sensor,
        frame_id=result.detections.frame_id,
        stamp_ns=result.detections.stamp_ns,
        log_time_ns=result.cloud.log_time_ns,
        points=len(result.cloud),
        ground_points=int(np.count_nonzero(result.ground)),
        timings_ms={stage: float(ms) for stage, ms in result.timings_ms.items()},
        dropped={reason: int(count) for reason, count in result.dropped.items()},
    )


def detections_of(finished: FinishedFrame, rows: pa.RecordBatch) -> Detections3D:
    """Return the boxes of a journalled frame, equal to those that were appended.

    Args:
        finished: The frame.
        rows: Its rows, with the schema `DETECTIONS_3D`.
    """

    def numbers(name: str) -> NDArray[Any]:
        column: NDArray[Any] = rows.column(name).to_numpy(zero_copy_only=False)
        return column

    return Detections3D(
        stamp_ns=finished.stamp_ns,
        sensor=finished.sensor,
        frame_id=finished.frame_id,
        boxes_m=np.column_stack([numbers(name) for name in BOX_COLUMNS]),
        labels=tuple(rows.column("label").to_pylist()),
        confidences=numbers("confidence"),
        mean_intensity=numbers("mean_intensity"),
        points=numbers("points"),
    )
