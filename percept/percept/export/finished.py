"""What is kept of a scan or an image that is finished: all that overlay and report need of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from percept.core.results import Detections2D, Detections3D
from percept.detection.result import ImageResult, Positions
from percept.export.tables import BOX_COLUMNS, PIXEL_COLUMNS
from percept.lidar.result import ScanResult

__all__ = [
    "FinishedFrame",
    "FinishedImage",
    "detections_of",
    "finished_frame",
    "finished_image",
    "image_of",
]


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


@dataclass(frozen=True, slots=True)
class FinishedImage:
    """What is kept of a finished image besides its rows.

    Attributes:
        frame: Number of the image in the run, over all cameras, from 0.
        camera: Name of the camera.
        frame_id: The camera's frame as the log names it; empty where it does not.
        stamp_ns: Time of the image.
        log_time_ns: Time of recording.
        width_px: Width of the recorded image; 0 where it cannot be decoded.
        height_px: Its height.
        decode_ms: Milliseconds for decoding it.
        timings_ms: By model that ran on it, in their order, milliseconds by stage.
        failure: Why the image could not be used, or None.
    """

    frame: int
    camera: str
    frame_id: str
    stamp_ns: int
    log_time_ns: int
    width_px: int = 0
    height_px: int = 0
    decode_ms: float = 0.0
    timings_ms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    failure: str | None = None


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


def finished_image(result: ImageResult) -> FinishedImage:
    """Return what the journal keeps of an image besides its boxes."""
    size = (0, 0) if result.image is None else result.image.pixels.shape[1::-1]
    return FinishedImage(
        frame=result.frame,
        camera=result.camera,
        frame_id="" if result.image is None else result.image.frame,
        stamp_ns=result.stamp_ns,
        log_time_ns=result.log_time_ns,
        width_px=size[0],
        height_px=size[1],
        decode_ms=float(result.decode_ms),
        timings_ms={
            model: {stage: float(ms) for stage, ms in result.timings_ms.get(model, {}).items()}
            for model in result.boxes
        },
        failure=result.failure,
    )


def detections_of(finished: FinishedFrame, rows: pa.RecordBatch) -> Detections3D:
    """Return the boxes of a journalled frame, equal to those that were appended.

    Args:
        finished: The frame.
        rows: Its rows, with the schema `DETECTIONS_3D`.
    """
    return Detections3D(
        stamp_ns=finished.stamp_ns,
        sensor=finished.sensor,
        frame_id=finished.frame_id,
        boxes_m=np.column_stack([_numbers(rows, name) for name in BOX_COLUMNS]),
        labels=_texts(rows, "label"),
        confidences=_numbers(rows, "confidence"),
        mean_intensity=_numbers(rows, "mean_intensity"),
        points=_numbers(rows, "points"),
        offsets_ns=_numbers(rows, "offset_ns"),
    )


def image_of(finished: FinishedImage, rows: pa.RecordBatch) -> ImageResult:
    """Return a journalled image without its pixels; its boxes equal those that were appended.

    A model of which no box has a position has no positions in it.

    Args:
        finished: The image.
        rows: Its rows, with the schema `DETECTIONS_2D`.
    """
    models = np.array(_texts(rows, "model"), dtype=object)
    parts = {model: rows.filter(pa.array(models == model)) for model in finished.timings_ms}
    return ImageResult(
        frame=finished.frame,
        camera=finished.camera,
        stamp_ns=finished.stamp_ns,
        log_time_ns=finished.log_time_ns,
        image=None,
        boxes={model: _boxes_of(finished, part) for model, part in parts.items()},
        primary={model: _numbers(part, "primary") for model, part in parts.items()},
        light_states={
            model: tuple(state or "" for state in part.column("light_state").to_pylist())
            for model, part in parts.items()
            if part.column("light_state").null_count < part.num_rows
        },
        positions={
            model: _positions_of(part)
            for model, part in parts.items()
            if part.column("depth_source").null_count < part.num_rows
        },
        decode_ms=finished.decode_ms,
        timings_ms=finished.timings_ms,
        failure=finished.failure,
    )


def _boxes_of(finished: FinishedImage, rows: pa.RecordBatch) -> Detections2D:
    return Detections2D(
        stamp_ns=finished.stamp_ns,
        camera=finished.camera,
        boxes_px=np.column_stack([_numbers(rows, name) for name in PIXEL_COLUMNS]),
        labels=_texts(rows, "label"),
        confidences=_numbers(rows, "confidence"),
    )


def _positions_of(rows: pa.RecordBatch) -> Positions:
    return Positions(
        frame_id=next(name for name in rows.column("frame_id").to_pylist() if name is not None),
        points_m=np.column_stack([_numbers(rows, name) for name in "xyz"]),
        range_m=_numbers(rows, "range_m"),
        sources=tuple(source or "" for source in rows.column("depth_source").to_pylist()),
        points=_numbers(rows, "depth_points"),
    )


def _numbers(rows: pa.RecordBatch, name: str) -> NDArray[Any]:
    """Return a column as an array; nulls among floats are NaN."""
    column: NDArray[Any] = rows.column(name).to_numpy(zero_copy_only=False)
    return column


def _texts(rows: pa.RecordBatch, name: str) -> tuple[str, ...]:
    return tuple(rows.column(name).to_pylist())
