"""`diff.parquet` and `diff_3d.parquet`: a row for each box that either of two labellings has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from percept.datasets.labelling.corrections.compare import SetDiff
from percept.datasets.labelling.corrections.diff_figures import BoxChange
from percept.datasets.labelling.labelled_set import ImageBoxes, SolidBoxes
from percept.export.tables import BOX_COLUMNS, PIXEL_COLUMNS, write_parquet

__all__ = ["DIFF_2D", "DIFF_3D", "write_diff_tables"]

_SIDES = ("a", "b")
_ROWS = 16_384


def _of_both(columns: Sequence[str]) -> Iterator[tuple[str, pa.DataType]]:
    for side in _SIDES:
        yield f"box_{side}", pa.int64()
        yield f"label_{side}", pa.string()
        yield f"confidence_{side}", pa.float64()
        yield f"source_{side}", pa.string()
        yield f"track_id_{side}", pa.int64()
        yield from ((f"{name}_{side}", pa.float64()) for name in columns)


DIFF_2D = pa.schema(
    [
        ("drive", pa.string()),
        ("camera", pa.string()),
        ("stamp_ns", pa.int64()),
        ("frame_a", pa.int64()),
        ("frame_b", pa.int64()),
        ("change", pa.string()),
        ("iou", pa.float64()),
        ("shift_px", pa.float64()),
        *_of_both(PIXEL_COLUMNS),
    ]
)
"""Columns of `diff.parquet`; those of a side that has no such box are null.

`change` is one of unchanged, moved, relabelled, added, removed; `shift_px` how far a side moved at
most.
"""

DIFF_3D = pa.schema(
    [
        ("drive", pa.string()),
        ("stamp_ns", pa.int64()),
        ("keyframe_a", pa.int64()),
        ("keyframe_b", pa.int64()),
        ("change", pa.string()),
        ("iou_bev", pa.float64()),
        ("shift_m", pa.float64()),
        *_of_both(BOX_COLUMNS),
    ]
)
"""Columns of `diff_3d.parquet`: the same of 3D boxes, in the base frame of the vehicle."""


def write_diff_tables(folder: Path, diff: SetDiff) -> None:
    """Write `diff.parquet` and, where there are 3D boxes, `diff_3d.parquet`.

    Raises:
        OSError: If the folder cannot be written.
    """
    write_parquet(folder / "diff.parquet", DIFF_2D, _batches(_image_rows(diff), DIFF_2D))
    if diff.moments:
        write_parquet(folder / "diff_3d.parquet", DIFF_3D, _batches(_solid_rows(diff), DIFF_3D))


def _batches(rows: Iterator[dict[str, Any]], schema: pa.Schema) -> Iterator[pa.Table]:
    while some := list(islice(rows, _ROWS)):
        yield pa.Table.from_pylist(some, schema=schema)


def _image_rows(diff: SetDiff) -> Iterator[dict[str, Any]]:
    for image in diff.images:
        for change in image.changes:
            yield {
                "drive": image.drive,
                "camera": image.a.camera,
                "stamp_ns": image.a.stamp_ns,
                "frame_a": image.a.frame,
                "frame_b": image.b.frame,
                "change": str(change.change),
                "iou": _known(change.iou),
                "shift_px": _known(change.shift),
                **_both(change, image.a.boxes, image.b.boxes),
            }


def _solid_rows(diff: SetDiff) -> Iterator[dict[str, Any]]:
    for moment in diff.moments:
        for change in moment.changes:
            yield {
                "drive": moment.a.drive,
                "stamp_ns": moment.a.stamp_ns,
                "keyframe_a": moment.a.keyframe,
                "keyframe_b": moment.b.keyframe,
                "change": str(change.change),
                "iou_bev": _known(change.iou),
                "shift_m": _known(change.shift),
                **_both(change, moment.a.solids, moment.b.solids),
            }


def _both(
    change: BoxChange, a: ImageBoxes | SolidBoxes, b: ImageBoxes | SolidBoxes
) -> dict[str, Any]:
    cells: dict[str, Any] = {}
    for side, boxes, row in zip(_SIDES, (a, b), (change.row_a, change.row_b), strict=True):
        if row is not None:
            cells |= {f"{name}_{side}": value for name, value in _cells(boxes, row).items()}
    return cells


def _cells(boxes: ImageBoxes | SolidBoxes, row: int) -> dict[str, Any]:
    if isinstance(boxes, ImageBoxes):
        place = dict(zip(PIXEL_COLUMNS, boxes.boxes_px[row].tolist(), strict=True))
    else:
        place = dict(zip(BOX_COLUMNS, boxes.boxes_m[row].tolist(), strict=True))
    track = int(boxes.track_ids[row])
    return {
        "box": int(boxes.ids[row]),
        "label": boxes.labels[row],
        "confidence": _known(boxes.confidences[row]),
        "source": boxes.sources[row],
        "track_id": track if track >= 0 else None,
        **place,
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
