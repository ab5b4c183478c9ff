"""Which scans a run looked at: those without an object too, which no table of boxes names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from percept.export.finished import FinishedFrame
from percept.export.table_reader import read_batches

__all__ = ["SCANS_3D", "read_scans", "scan_rows"]

SCANS_3D = pa.schema(
    [
        ("frame", pa.int64()),
        ("stamp_ns", pa.int64()),
        ("log_time_ns", pa.int64()),
        ("sensor", pa.string()),
        ("frame_id", pa.string()),
        ("points", pa.int64()),
        ("objects", pa.int64()),
    ]
)
"""Columns of `scans_3d.parquet`: a row for each scan, in the order of its number `frame`."""


def scan_rows(finished: FinishedFrame, objects: int) -> pa.RecordBatch:
    """Return a scan's row of `scans_3d.parquet`, with the schema `SCANS_3D`.

    Args:
        finished: The scan.
        objects: Boxes that were found in it.
    """
    row = {name: getattr(finished, name) for name in SCANS_3D.names if name != "objects"}
    return pa.RecordBatch.from_pylist([{**row, "objects": objects}], schema=SCANS_3D)


def read_scans(path: Path) -> Iterator[tuple[FinishedFrame, int]]:
    """Yield the scans of a `scans_3d.parquet` as the table has them, and their boxes' number.

    Raises:
        InputError: If the file is no such table.
    """
    for batch in read_batches(path, SCANS_3D):
        for row in batch.to_pylist():
            objects = row.pop("objects")
            yield FinishedFrame(**row), objects
