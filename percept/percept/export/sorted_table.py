"""A result table whose rows are in the order of a key: the rows of any key, and little memory."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.export.table_reader import column, group_ends, read_batches

__all__ = ["SortedTable"]

_GROUPS_HELD = 3


class SortedTable:
    """Looks rows up by a whole-numbered column that never falls.

    Making it reads that column alone; of the others some row groups are held at a time.

    Args:
        path: A Parquet file.
        schema: The columns that are needed.
        key: Name of the column.
        may_lack: Names of columns that may have empty cells, or numbers that are not finite.

    Raises:
        InputError: If the file cannot be read, is no such table, or the column falls.

    Attributes:
        keys: (K,) int64 the values of the key, each once, rising.
    """

    def __init__(
        self, path: Path, schema: pa.Schema, key: str, *, may_lack: Collection[str] = ()
    ) -> None:
        self._path, self._schema, self._may_lack = path, schema, tuple(may_lack)
        self._ends = group_ends(path)
        self.keys, self._starts = self._index(key)
        self._group = lru_cache(maxsize=_GROUPS_HELD)(self._read_group)

    def rows(self, key: int) -> pa.RecordBatch:
        """Return the rows of a key; none where no row has it.

        Raises:
            InputError: If the file cannot be read, or holds what it must not.
        """
        place = int(np.searchsorted(self.keys, key))
        if place == len(self.keys) or self.keys[place] != key:
            return pa.RecordBatch.from_pylist([], schema=self._schema)
        start, end = int(self._starts[place]), int(self._starts[place + 1])
        first, last = np.searchsorted(self._ends, [start, end - 1], side="right").tolist()
        parts = []
        for group in range(first, last + 1):
            begun = int(self._ends[group - 1]) if group else 0
            low, high = max(start - begun, 0), min(end - begun, int(self._ends[group]) - begun)
            parts.append(self._group(group).slice(low, high - low))
        return pa.concat_batches(parts)

    def around(self, key: int) -> tuple[int | None, int | None]:
        """Return the last key at or before a value, and the first one after it."""
        after = int(np.searchsorted(self.keys, key, side="right"))
        before = int(self.keys[after - 1]) if after else None
        return before, int(self.keys[after]) if after < len(self.keys) else None

    def _index(self, key: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the keys (K,), and (K + 1,) the row at which each begins and the last one ends."""
        schema = pa.schema([self._schema.field(key)])
        keys, starts, rows = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], 0
        last: int | None = None
        for batch in read_batches(self._path, schema):
            values = column(batch, key)
            if not len(values):
                continue
            steps = np.diff(values, prepend=values[0] if last is None else last)
            if (steps < 0).any():
                raise InputError(f"its rows are not in the order of {key}", where=self._path)
            changes = np.flatnonzero(steps)
            if last is None:
                changes = np.concatenate([[0], changes])
            keys.append(values[changes])
            starts.append(changes + rows)
            rows += len(values)
            last = int(values[-1])
        return np.concatenate(keys), np.concatenate([*starts, [rows]]).astype(np.int64)

    def _read_group(self, group: int) -> pa.RecordBatch:
        batches = read_batches(self._path, self._schema, may_lack=self._may_lack, groups=[group])
        return pa.concat_batches(list(batches))
