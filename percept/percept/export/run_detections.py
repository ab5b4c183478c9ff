"""The detections of a finished run, read back in the order of their times, the empty ones too.

The tables are in the order in which the run finished its frames. A frame that comes too early
waits; since sensors take turns few do, and memory does not grow with the boxes of a run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from percept.core.errors import InputError
from percept.core.results import Detections2D, Detections3D
from percept.export.finished import detections_of
from percept.export.image_table import IMAGES_2D
from percept.export.scan_table import read_scans
from percept.export.table_reader import column, columns, read_batches, row_groups, texts
from percept.export.tables import DETECTIONS_2D, DETECTIONS_3D, PIXEL_COLUMNS

__all__ = ["BOXES_2D", "boxes_by_model", "read_detections_2d", "read_detections_3d"]

BOXES_2D = pa.schema(
    [
        DETECTIONS_2D.field(name)
        for name in (
            "frame",
            "model",
            *PIXEL_COLUMNS,
            "label",
            "confidence",
            "primary",
            "light_state",
        )
    ]
)
"""Columns of `detections_2d.parquet` that make boxes; `light_state` may have empty cells."""

_LOOKS = pa.schema([IMAGES_2D.field(name) for name in ("frame", "stamp_ns", "camera", "model")])


def read_detections_3d(run: Path) -> Iterator[Detections3D]:
    """Yield what was found in each scan of a run, in the order of stamp and sensor.

    Args:
        run: A run folder with `scans_3d.parquet` and `detections_3d.parquet`.

    Raises:
        InputError: If a table is missing or damaged, or the two do not fit together.
    """
    path = run / "detections_3d.parquet"
    scans = {scan.frame: (scan, objects) for scan, objects in read_scans(_table(run, "scans_3d"))}
    order = sorted(scans, key=lambda f: (scans[f][0].stamp_ns, scans[f][0].sensor, f))
    batches = read_batches(path, DETECTIONS_3D, may_lack=("mean_intensity",))
    for frame, rows in _in_order(path, order, scans, batches):
        scan, objects = scans[frame]
        boxes = _no_rows(DETECTIONS_3D) if rows is None else rows
        if len(boxes) != objects:
            raise InputError(
                f"has {len(boxes)} boxes of frame {frame}, which has {objects} in scans_3d.parquet",
                where=path,
            )
        yield detections_of(scan, boxes)


def read_detections_2d(
    run: Path, *, models: Collection[str] | None = None
) -> Iterator[Detections2D]:
    """Yield what was found in each image of a run, in the order of stamp and camera.

    Images that no network could judge are left out. The label of a traffic light whose state was
    read from its picture ends with that state.

    Args:
        run: A run folder with `images_2d.parquet` and `detections_2d.parquet`.
        models: The networks whose boxes to take, and whose images. None takes all networks; of
            an object that several found in one image then only the most confident box.

    Raises:
        InputError: If a table is missing or damaged, or the two do not fit together.
    """
    path = run / "detections_2d.parquet"
    listed: set[int] = set()
    images: dict[int, tuple[int, str]] = {}
    for batch in read_batches(_table(run, "images_2d"), _LOOKS, may_lack=("model",)):
        listed.update(column(batch, "frame").tolist())
        for look in batch.to_pylist():
            if look["model"] is not None and (models is None or look["model"] in models):
                images[look["frame"]] = (look["stamp_ns"], look["camera"])
    order = sorted(images, key=lambda frame: (*images[frame], frame))
    for frame, rows in _in_order(
        path, order, listed, read_batches(path, BOXES_2D, may_lack=("light_state",))
    ):
        stamp_ns, camera = images[frame]
        yield _image_boxes(stamp_ns, camera, rows, models)


def boxes_by_model(
    stamp_ns: int, camera: str, rows: pa.RecordBatch, models: Iterable[str]
) -> dict[str, Detections2D]:
    """Return the boxes of each network in one image, those without a box too.

    Args:
        stamp_ns: Time of the image.
        camera: Name of the camera.
        rows: Its rows, with the schema `BOXES_2D`.
        models: The networks that looked at it.
    """
    of = np.array(texts(rows, "model"), dtype=object)
    return {
        model: _boxes(stamp_ns, camera, rows.filter(pa.array(of == model, type=pa.bool_())))
        for model in models
    }


def _image_boxes(
    stamp_ns: int, camera: str, rows: pa.RecordBatch | None, models: Collection[str] | None
) -> Detections2D:
    boxes = _no_rows(BOXES_2D) if rows is None else rows
    taken = (
        column(boxes, "primary")
        if models is None
        else np.array([model in models for model in texts(boxes, "model")], dtype=bool)
    )
    return _boxes(stamp_ns, camera, boxes.filter(pa.array(taken, type=pa.bool_())))


def _boxes(stamp_ns: int, camera: str, boxes: pa.RecordBatch) -> Detections2D:
    return Detections2D(
        stamp_ns=stamp_ns,
        camera=camera,
        boxes_px=columns(boxes, PIXEL_COLUMNS),
        labels=tuple(
            f"{label} {state}" if state else label
            for label, state in zip(
                texts(boxes, "label"), boxes.column("light_state").to_pylist(), strict=True
            )
        ),
        confidences=column(boxes, "confidence"),
    )


def _no_rows(schema: pa.Schema) -> pa.RecordBatch:
    return pa.RecordBatch.from_pylist([], schema=schema)


def _in_order(
    path: Path,
    order: Sequence[int],
    listed: Collection[int],
    batches: Iterable[pa.RecordBatch],
) -> Iterator[tuple[int, pa.RecordBatch | None]]:
    """Yield the rows of each frame in an order of frames; None for a frame without rows.

    Args:
        path: The file that the rows are from, in the order of their frames.
        order: Numbers of the frames that are wanted.
        listed: Numbers of all frames that the run has.
        batches: The rows.
    """
    wanted = set(order)
    waiting: dict[int, pa.RecordBatch] = {}
    groups = row_groups(path, batches, "frame")
    last = -1
    for frame in [*order, None]:  # behind the last one, the rest of the rows is looked at
        while frame is None or last < frame:
            group = next(groups, None)
            if group is None:
                break
            last, rows = group
            if last not in listed:
                raise InputError(f"has boxes of frame {last}, which the run has not", where=path)
            if last in wanted:
                waiting[last] = rows
        if frame is not None:
            yield frame, waiting.pop(frame, None)


def _table(run: Path, name: str) -> Path:
    path = run / f"{name}.parquet"
    if not path.is_file():
        raise InputError(
            f"has no {path.name}, without which empty frames are not known",
            where=run,
            remedy="Detect again with this version",
        )
    return path
