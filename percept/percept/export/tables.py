"""Result tables: their schemas, and Parquet files whose bytes depend on the rows alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from percept.core.results import Detections3D
from percept.detection.result import ImageResult, Positions

__all__ = [
    "BOX_COLUMNS",
    "DETECTIONS_2D",
    "DETECTIONS_3D",
    "PIXEL_COLUMNS",
    "detections_2d_table",
    "detections_3d_table",
    "write_parquet",
]

_ROWS_PER_GROUP = 65_536
BOX_COLUMNS = ("x", "y", "z", "length", "width", "height", "yaw_rad")
"""Columns of a box, in the order of `Detections3D.boxes_m`."""

DETECTIONS_3D = pa.schema(
    [
        ("frame", pa.int64()),
        ("stamp_ns", pa.int64()),
        ("sensor", pa.string()),
        ("frame_id", pa.string()),
        *((name, pa.float64()) for name in BOX_COLUMNS),
        ("label", pa.string()),
        ("confidence", pa.float64()),
        ("mean_intensity", pa.float64()),
        ("points", pa.int64()),
        ("offset_ns", pa.int64()),
    ]
)
"""Columns of `detections_3d.parquet`: metres and rad in the frame `frame_id`, one row a box.

`offset_ns` is when the box was measured, counted from `stamp_ns`: the mean time of its points.
"""

PIXEL_COLUMNS = ("x1_px", "y1_px", "x2_px", "y2_px")
"""Columns of a box in an image, in the order of `Detections2D.boxes_px`."""

DETECTIONS_2D = pa.schema(
    [
        ("frame", pa.int64()),
        ("stamp_ns", pa.int64()),
        ("camera", pa.string()),
        ("model", pa.string()),
        *((name, pa.float64()) for name in PIXEL_COLUMNS),
        ("label", pa.string()),
        ("confidence", pa.float64()),
        ("primary", pa.bool_()),
        ("range_m", pa.float64()),
        ("x", pa.float64()),
        ("y", pa.float64()),
        ("z", pa.float64()),
        ("frame_id", pa.string()),
        ("depth_source", pa.string()),
        ("depth_points", pa.int64()),
        ("light_state", pa.string()),
    ]
)
"""Columns of `detections_2d.parquet`: pixels of the recorded image, metres, one row a box.

`frame` numbers the images of the run over all cameras. `primary` is false where another model
found the same object in the same image with more confidence. `light_state` is what a traffic light
shows whose label does not tell, else null. Where the position of an object is
not known, `range_m`, `x`, `y`, `z`, `frame_id` and `depth_source` are null and `depth_points` is 0.
"""


def detections_3d_table(frame: int, detections: Detections3D) -> pa.Table:
    """Return the boxes of one scan as rows of `detections_3d.parquet`.

    Args:
        frame: Number of the scan in the run, from 0.
        detections: N boxes.

    Returns:
        N rows with the schema `DETECTIONS_3D`.
    """
    rows = len(detections)
    columns = [
        np.full(rows, frame, dtype=np.int64),
        np.full(rows, detections.stamp_ns, dtype=np.int64),
        [detections.sensor] * rows,
        [detections.frame_id] * rows,
        *detections.boxes_m.T,
        list(detections.labels),
        detections.confidences,
        detections.mean_intensity,
        detections.points,
        detections.offsets_ns,
    ]
    arrays = [
        pa.array(column, type=field.type)
        for column, field in zip(columns, DETECTIONS_3D, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=DETECTIONS_3D)


def detections_2d_table(result: ImageResult) -> pa.Table:
    """Return the boxes of one image as rows of `detections_2d.parquet`.

    Args:
        result: The image; a box counts as primary where nothing else is said.

    Returns:
        A row for each box with the schema `DETECTIONS_2D`: the models in their order, and the
        boxes of each in theirs.
    """
    return pa.concat_tables(
        [DETECTIONS_2D.empty_table(), *(_rows_of_model(result, model) for model in result.boxes)]
    )


def _rows_of_model(result: ImageResult, model: str) -> pa.Table:
    found = result.boxes[model]
    rows = len(found)
    positions = result.positions.get(model) or Positions.unknown(rows)
    known = [bool(source) for source in positions.sources]
    columns = [
        np.full(rows, result.frame, dtype=np.int64),
        np.full(rows, result.stamp_ns, dtype=np.int64),
        [result.camera] * rows,
        [model] * rows,
        *found.boxes_px.T,
        list(found.labels),
        found.confidences,
        result.primary.get(model, np.ones(rows, dtype=bool)),
        positions.range_m,
        *positions.points_m.T,
        [positions.frame_id if is_known else None for is_known in known],
        [source or None for source in positions.sources],
        positions.points,
        [state or None for state in result.light_states.get(model, ("",) * rows)],
    ]
    arrays = [
        pa.array(column, type=field.type, from_pandas=True)  # NaN, which is unknown, is null
        for column, field in zip(columns, DETECTIONS_2D, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=DETECTIONS_2D)


def write_parquet(
    path: Path, schema: pa.Schema, batches: Iterable[pa.Table | pa.RecordBatch]
) -> int:
    """Write a Parquet file row group by row group, and give it its name when it is whole.

    Row groups have a fixed number of rows, so that the same rows give the same bytes however
    they were batched. Memory holds one row group.

    Args:
        path: Where the file goes; an older file there is replaced.
        schema: Columns of all batches.
        batches: Rows in their final order.

    Returns:
        The number of rows.
    """
    unfinished = path.with_name(f".{path.name}.unfinished")
    rows = 0
    try:
        with pq.ParquetWriter(
            unfinished, schema, compression="zstd", compression_level=3, store_schema=False
        ) as writer:
            for group in _row_groups(schema, batches):
                writer.write_table(group, row_group_size=_ROWS_PER_GROUP)
                rows += group.num_rows
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return rows


def _row_groups(
    schema: pa.Schema, batches: Iterable[pa.Table | pa.RecordBatch]
) -> Iterator[pa.Table]:
    """Cut a stream of batches into contiguous tables of `_ROWS_PER_GROUP` rows; the last is less.

    Pages end where the chunks of a column end, so chunks are joined before they are written.
    """
    pending: list[pa.Table] = []
    rows = 0
    for batch in batches:
        table = pa.Table.from_batches([batch]) if isinstance(batch, pa.RecordBatch) else batch
        pending.append(table.select(schema.names).cast(schema))
        rows += table.num_rows
        while rows >= _ROWS_PER_GROUP:
            joined = pa.concat_tables(pending)
            yield joined.slice(0, _ROWS_PER_GROUP).combine_chunks()
            pending = [joined.slice(_ROWS_PER_GROUP)]
            rows -= _ROWS_PER_GROUP
    if rows:
        yield pa.concat_tables(pending).combine_chunks()
