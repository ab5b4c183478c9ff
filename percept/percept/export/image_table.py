"""Which images a run looked at: those without a box too, which no table of boxes names."""

from __future__ import annotations

import pyarrow as pa

from percept.export.finished import FinishedImage

__all__ = ["IMAGES_2D", "image_rows"]

IMAGES_2D = pa.schema(
    [
        ("frame", pa.int64()),
        ("stamp_ns", pa.int64()),
        ("camera", pa.string()),
        ("model", pa.string()),
        ("failure", pa.string()),
    ]
)
"""Columns of `images_2d.parquet`: a row for each image and each model that could judge it.

An image that could not be used, at all or by one of the models, has one row more, without a
model, that says why.
"""


def image_rows(finished: FinishedImage) -> pa.RecordBatch:
    """Return an image's rows of `images_2d.parquet`, with the schema `IMAGES_2D`."""
    looks: list[tuple[str | None, str | None]] = [(model, None) for model in finished.timings_ms]
    if finished.failure is not None:
        looks.append((None, finished.failure))
    rows = [
        {
            "frame": finished.frame,
            "stamp_ns": finished.stamp_ns,
            "camera": finished.camera,
            "model": model,
            "failure": failure,
        }
        for model, failure in looks
    ]
    return pa.RecordBatch.from_pylist(rows, schema=IMAGES_2D)
