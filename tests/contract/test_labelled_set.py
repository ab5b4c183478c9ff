"""The tables of a labelled set: read back they are what was written, and strangers' are refused."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from made_labelled_set import make_labelled_set

from percept.core.errors import InputError
from percept.core.transform import Transform
from percept.datasets.labelling.labelled_set import LabelledSet
from percept.datasets.labelling.set_tables import read_set


def _same(a: Any, b: Any) -> None:
    assert type(a) is type(b)
    if isinstance(a, Transform):
        assert (a.target, a.source) == (b.target, b.source)
        np.testing.assert_allclose(a.matrix, b.matrix, atol=1e-12)
    elif is_dataclass(a):
        for field in fields(a):
            _same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            _same(one, other)
    elif isinstance(a, dict):
        assert list(a) == list(b)
        _same(tuple(a.values()), tuple(b.values()))
    else:
        assert a == b or (a != a and b != b)


@pytest.fixture
def made(tmp_path: Path) -> LabelledSet:
    return make_labelled_set(tmp_path / "set")


def test_a_set_read_back_is_the_set(made: LabelledSet) -> None:
    _same(made, read_set(made.folder))


def test_a_set_without_scans_places_and_rectified_images_too(tmp_path: Path) -> None:
    made = make_labelled_set(
        tmp_path / "set", with_scans=False, located=False, rectified_suffix=None
    )
    _same(made, read_set(made.folder))


@pytest.mark.parametrize("name", ["../../x.jpg", "/etc/passwd"])
def test_a_file_outside_the_folder_is_refused(made: LabelledSet, name: str) -> None:
    path = made.folder / "frames.parquet"
    table = pq.read_table(path)
    files = pa.array([name, *table["file"].to_pylist()[1:]])
    pq.write_table(table.set_column(table.schema.get_field_index("file"), "file", files), path)
    with pytest.raises(InputError, match="outside the folder"):
        read_set(made.folder)


def test_damaged_sets_are_named(made: LabelledSet) -> None:
    (made.folder / "boxes_3d.parquet").write_bytes(b"PAR1 nonsense")
    with pytest.raises(InputError, match=r"boxes_3d.parquet: cannot be read"):
        read_set(made.folder)
    (made.folder / "boxes_3d.parquet").unlink()
    with pytest.raises(InputError, match=r"boxes_3d.parquet: is missing"):
        read_set(made.folder)
    record = json.loads((made.folder / "dataset.json").read_text())
    (made.folder / "dataset.json").write_text(json.dumps({**record, "surprise": 1}))
    with pytest.raises(InputError, match="cannot be read as the record"):
        read_set(made.folder)
    with pytest.raises(InputError, match="holds no data set"):
        read_set(made.folder / "images")
