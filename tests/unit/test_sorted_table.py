"""Rows of a table by their key, wherever row groups end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from percept.core.errors import InputError
from percept.export.sorted_table import SortedTable

_SCHEMA = pa.schema([("key", pa.int64()), ("name", pa.string())])


def written(path: Path, keys: Sequence[int], *, group: int) -> Path:
    rows = pa.table({"key": keys, "name": [str(n) for n in range(len(keys))]}, _SCHEMA)
    pq.write_table(rows, path, row_group_size=group)
    return path


@pytest.mark.parametrize("group", [1, 2, 3, 100])
def test_rows_of_each_key(tmp_path: Path, group: int) -> None:
    keys = [3, 3, 5, 7, 7, 7, 7, 9]
    table = SortedTable(written(tmp_path / "t.parquet", keys, group=group), _SCHEMA, "key")
    assert table.keys.tolist() == [3, 5, 7, 9]
    for key in (9, 3, 7, 5, 7):
        expected = [str(n) for n, one in enumerate(keys) if one == key]
        assert table.rows(key).column("name").to_pylist() == expected
    assert table.rows(4).num_rows == table.rows(10).num_rows == 0
    assert table.rows(4).schema == _SCHEMA


def test_keys_around_a_value(tmp_path: Path) -> None:
    table = SortedTable(written(tmp_path / "t.parquet", [3, 3, 5], group=2), _SCHEMA, "key")
    assert table.around(2) == (None, 3)
    assert table.around(3) == (3, 5)
    assert table.around(4) == (3, 5)
    assert table.around(5) == (5, None)


def test_empty_table(tmp_path: Path) -> None:
    table = SortedTable(written(tmp_path / "t.parquet", [], group=2), _SCHEMA, "key")
    assert table.rows(1).num_rows == 0
    assert table.around(1) == (None, None)


@pytest.mark.parametrize("group", [1, 4])
def test_key_that_falls_is_refused(tmp_path: Path, group: int) -> None:
    path = written(tmp_path / "t.parquet", [3, 5, 4], group=group)
    with pytest.raises(InputError, match="not in the order of key"):
        SortedTable(path, _SCHEMA, "key")
