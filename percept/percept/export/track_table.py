"""Tracks as a table: `tracks.parquet`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from percept.core.errors import InputError
from percept.core.results import Tracks
from percept.export.table_reader import column, columns, read_batches, row_groups, texts
from percept.export.tables import BOX_COLUMNS

__all__ = ["TRACKS", "TRACKS_MAY_LACK", "read_tracks", "track_rows", "tracks_of"]

TRACKS = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("track_id", pa.int64()),
        ("frame_id", pa.string()),
        *((name, pa.float64()) for name in BOX_COLUMNS),
        ("vx", pa.float64()),
        ("vy", pa.float64()),
        ("label", pa.string()),
        ("label_probability", pa.float64()),
        ("state", pa.string()),
        ("position_sd_m", pa.float64()),
        ("velocity_sd_mps", pa.float64()),
        ("observed", pa.bool_()),
        ("score", pa.float64()),
    ]
)
"""Columns of `tracks.parquet`: a row for each track and moment, in order of time.

Metres, rad and m/s in the frame `frame_id`, which does not move; see `percept.core.results.Tracks`.
`score` is null where it is not known. A moment without a track has no row.
"""

TRACKS_MAY_LACK = ("score",)
"""Columns of `tracks.parquet` that may have empty cells."""


def track_rows(tracks: Tracks) -> pa.RecordBatch:
    """Return the tracks of a moment as rows with the schema `TRACKS`."""
    count = len(tracks)
    values = [
        [tracks.stamp_ns] * count,
        tracks.ids,
        [tracks.frame_id] * count,
        *tracks.boxes_m.T,
        *tracks.velocities_mps.T,
        list(tracks.labels),
        tracks.label_probabilities,
        list(tracks.states),
        tracks.position_sd_m,
        tracks.velocity_sd_mps,
        tracks.observed,
        pa.array(tracks.scores, from_pandas=True),  # NaN, which is unknown, is null
    ]
    arrays = [pa.array(v, type=field.type) for v, field in zip(values, TRACKS, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=TRACKS)


def read_tracks(path: Path) -> Iterator[Tracks]:
    """Yield the moments of a `tracks.parquet` that have a track, in order of time.

    Raises:
        InputError: If the file is no such table, its rows are not in order of time, or one
            moment has several frames.
    """
    batches = read_batches(path, TRACKS, may_lack=TRACKS_MAY_LACK)
    for _, rows in row_groups(path, batches, "stamp_ns"):
        yield tracks_of(path, rows)


def tracks_of(path: Path, rows: pa.RecordBatch) -> Tracks:
    """Return the tracks of one moment from its rows, of which there is one at least.

    Args:
        path: The file that the rows are from.
        rows: With the schema `TRACKS`.

    Raises:
        InputError: If the moment has several frames.
    """
    stamp_ns = int(column(rows, "stamp_ns")[0])
    frame_id, *others = sorted(set(texts(rows, "frame_id")))
    if others:
        raise InputError(f"time {stamp_ns} has several frames", where=path)
    return Tracks(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        ids=column(rows, "track_id"),
        boxes_m=columns(rows, BOX_COLUMNS),
        velocities_mps=columns(rows, ("vx", "vy")),
        labels=texts(rows, "label"),
        label_probabilities=column(rows, "label_probability"),
        states=texts(rows, "state"),
        position_sd_m=column(rows, "position_sd_m"),
        velocity_sd_mps=column(rows, "velocity_sd_mps"),
        observed=column(rows, "observed"),
        scores=column(rows, "score"),
    )
