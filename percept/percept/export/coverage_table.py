"""What of a map was seen, and how poses lay against it: coverage and offsets as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import pyarrow as pa

from percept.hdmap.validate import ElementCoverage, StretchOffset

__all__ = ["COVERAGE", "OFFSETS", "coverage_rows", "offset_rows"]

COVERAGE = pa.schema(
    [
        ("map_element_id", pa.int64()),
        ("along_m", pa.float64()),
        ("length_m", pa.float64()),
        ("observed_share", pa.float64()),
        ("visits", pa.int64()),
        ("reason", pa.string()),
    ]
)
"""Columns of `coverage.parquet`: stretches of the map's elements along the way.

`observed_share` of the stretch was seen often enough to judge it, in `visits` visits at most;
`reason` says why the rest was not. What was not seen never counts as missing.
"""

OFFSETS = pa.schema(
    [
        ("drive", pa.int64()),
        *(
            (name, pa.float64())
            for name in (
                "along_m", "x_m", "y_m", "yaw_rad", "lateral_m", "heading_rad", "sd_m", "lines"
            )
        ),
        ("ambiguous", pa.bool_()),
    ]
)  # fmt: skip
"""Columns of `offsets.parquet`: how far the paint lay left of the map, along each drive.

See `percept.hdmap.validate.StretchOffset`.
"""


def coverage_rows(coverage: Sequence[ElementCoverage]) -> pa.RecordBatch:
    """Return stretches as rows with the schema `COVERAGE`."""
    return _rows([astuple(stretch) for stretch in coverage], COVERAGE)


def offset_rows(offsets: Sequence[StretchOffset]) -> pa.RecordBatch:
    """Return offsets as rows with the schema `OFFSETS`."""
    return _rows([astuple(offset) for offset in offsets], OFFSETS)


def _rows(rows: Sequence[tuple[object, ...]], schema: pa.Schema) -> pa.RecordBatch:
    columns = zip(*rows, strict=True) if rows else ((),) * len(schema)
    arrays = [
        pa.array(column, type=field.type) for column, field in zip(columns, schema, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)
