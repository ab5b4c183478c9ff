"""Traffic lights as a table: `lights.parquet`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from percept.core.results import LightStates
from percept.export.table_reader import column, read_batches, row_groups, texts

__all__ = ["LIGHTS", "light_rows", "read_lights"]

LIGHTS = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("light_id", pa.int64()),
        ("state", pa.string()),
        ("flashing", pa.bool_()),
        ("probability", pa.float64()),
        ("cameras", pa.string()),
    ]
)
"""Columns of `lights.parquet`: a row for each light and moment, in order of time.

`cameras` are the cameras that saw it, with commas between them; empty where none did. A moment
without a light has no row. See `percept.core.results.LightStates`.
"""


def light_rows(lights: LightStates) -> pa.RecordBatch:
    """Return the lights of a moment as rows with the schema `LIGHTS`."""
    values = [
        [lights.stamp_ns] * len(lights),
        lights.ids,
        list(lights.states),
        lights.flashing,
        lights.probabilities,
        [",".join(cameras) for cameras in lights.cameras],
    ]
    arrays = [pa.array(v, type=field.type) for v, field in zip(values, LIGHTS, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=LIGHTS)


def read_lights(path: Path) -> Iterator[LightStates]:
    """Yield the moments of a `lights.parquet` that have a light, in order of time.

    Raises:
        InputError: If the file is no such table, or its rows are not in order of time.
    """
    for stamp_ns, rows in row_groups(path, read_batches(path, LIGHTS), "stamp_ns"):
        cameras = (text.split(",") if text else () for text in texts(rows, "cameras"))
        yield LightStates(
            stamp_ns=stamp_ns,
            ids=column(rows, "light_id"),
            states=texts(rows, "state"),
            flashing=column(rows, "flashing"),
            probabilities=column(rows, "probability"),
            cameras=tuple(tuple(names) for names in cameras),
        )
