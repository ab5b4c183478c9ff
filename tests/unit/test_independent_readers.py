"""A test that needs the independent readers fails without them, and says what makes them."""

from __future__ import annotations

from pathlib import Path

import independent_readers
import pytest
from independent_readers import read_with


@pytest.mark.parametrize("releases", [None, "datumaro==0.1\n"])
def test_without_the_pinned_readers_a_test_fails(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, releases: str | None
) -> None:
    if releases is not None:
        (tmp_path / "readers.txt").write_text(releases, "utf-8")
    monkeypatch.setattr(independent_readers, "_ENVIRONMENT", tmp_path)
    with pytest.raises(pytest.fail.Exception, match="run scripts/oracles"):
        read_with("read_parquet.py")


def test_a_reader_that_refuses_an_export_fails_the_test(tmp_path: Path) -> None:
    with pytest.raises(pytest.fail.Exception, match=r"(?s)read_parquet.py cannot read.*nothing"):
        read_with("read_parquet.py", tmp_path / "nothing.parquet")
