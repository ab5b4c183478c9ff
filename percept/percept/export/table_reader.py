"""Result tables read back: what does not fit is said in one line, and memory holds a batch."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from percept.core.errors import InputError

__all__ = ["column", "columns", "group_ends", "has_column", "read_batches", "row_groups", "texts"]

_ROWS_PER_BATCH = 65_536


def read_batches(
    path: Path,
    schema: pa.Schema,
    *,
    may_lack: Collection[str] = (),
    groups: Sequence[int] | None = None,
) -> Iterator[pa.RecordBatch]:
    """Yield the rows of a table with exactly the columns and types of a schema.

    Further columns of the file are left out.

    Args:
        path: A Parquet file.
        schema: The columns that are needed.
        may_lack: Names of columns that may have empty cells, or numbers that are not finite.
        groups: Numbers of the row groups to read; None reads all.

    Raises:
        InputError: If the file cannot be read, lacks a column, or a column has the wrong type,
            empty cells or numbers that are not finite.
    """
    with _opened(path) as file:
        _check_columns(path, file.schema_arrow, schema)
        for batch in file.iter_batches(_ROWS_PER_BATCH, row_groups=groups, columns=schema.names):
            rows = batch.select(schema.names).cast(schema)
            rows.validate(full=True)
            _check_cells(path, rows.drop_columns(list(may_lack)))
            yield rows


def group_ends(path: Path) -> NDArray[np.int64]:
    """Return (G,) the number of rows up to the end of each row group of a table.

    Raises:
        InputError: If the file cannot be read.
    """
    with _opened(path) as file:
        sizes = [file.metadata.row_group(n).num_rows for n in range(file.metadata.num_row_groups)]
    return np.cumsum(np.array(sizes, dtype=np.int64))


def has_column(path: Path, name: str) -> bool:
    """Return whether a table has a column.

    Raises:
        InputError: If the file cannot be read.
    """
    with _opened(path) as file:
        return name in file.schema_arrow.names


def row_groups(
    path: Path, batches: Iterable[pa.RecordBatch], key: str
) -> Iterator[tuple[int, pa.RecordBatch]]:
    """Yield the rows of each value of a whole-numbered column that never falls.

    Args:
        path: The file that the rows are from.
        batches: Its rows.
        key: Name of the column.

    Raises:
        InputError: If the column falls.
    """
    pending: list[pa.RecordBatch] = []
    for batch in batches:
        rows = pa.concat_batches([*pending, batch])
        values = column(rows, key)
        if np.any(np.diff(values) < 0):
            raise InputError(f"its rows are not in the order of {key}", where=path)
        starts = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist()] if len(values) else []
        for start, end in pairwise(starts):
            yield int(values[start]), rows.slice(start, end - start)
        pending = [rows.slice(starts[-1])] if starts else []  # it may go on in the next batch
    for rows in pending:
        yield int(column(rows, key)[0]), rows


def column(rows: pa.RecordBatch, name: str) -> NDArray[Any]:
    """Return a column of numbers or truth values as an array (N,)."""
    values: NDArray[Any] = rows.column(name).to_numpy(zero_copy_only=False)
    return values


def columns(rows: pa.RecordBatch, names: Iterable[str]) -> NDArray[np.float64]:
    """Return several columns of numbers as an array (N, their number) float64."""
    return np.column_stack([column(rows, name) for name in names]).astype(np.float64)


def texts(rows: pa.RecordBatch, name: str) -> tuple[str, ...]:
    """Return a column of texts."""
    return tuple(rows.column(name).to_pylist())


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a Parquet file, and translate whatever reading it ends with."""
    if not path.is_file():
        raise InputError("there is no such table", where=path)
    try:
        with pq.ParquetFile(path) as file:
            yield file
    except (pa.ArrowException, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"cannot be read as Parquet ({reason})", where=path) from error


def _is_text(kind: pa.DataType) -> bool:
    inner = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(inner) or pa.types.is_large_string(inner))


_FITS: dict[pa.DataType, Callable[[pa.DataType], bool]] = {
    pa.int64(): pa.types.is_integer,
    pa.float64(): lambda kind: pa.types.is_floating(kind) or pa.types.is_integer(kind),
    pa.bool_(): pa.types.is_boolean,
    pa.string(): _is_text,
}


def _check_columns(path: Path, found: pa.Schema, wanted: pa.Schema) -> None:
    missing = [name for name in wanted.names if name not in found.names]
    if missing:
        raise InputError(f"has no column {', '.join(missing)}", where=path)
    for field in wanted:
        kind = found.field(field.name).type
        if not _FITS[field.type](kind):
            raise InputError(f"column {field.name} is {kind}, not {field.type}", where=path)


def _check_cells(path: Path, rows: pa.RecordBatch) -> None:
    for field in rows.schema:
        if rows.column(field.name).null_count:
            raise InputError(f"column {field.name} has empty cells", where=path)
        is_number = pa.types.is_floating(field.type)
        if is_number and not np.isfinite(column(rows, field.name)).all():
            raise InputError(f"column {field.name} holds numbers that are not finite", where=path)
