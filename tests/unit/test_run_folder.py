"""The run folder: what is removed before a run, what is left alone, and who may write."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from percept.cli.run_folder import RunFolder
from percept.core.errors import UsageError
from percept.core.results import Verdict


@pytest.fixture
def finished(tmp_path: Path) -> Path:
    """The folder of an earlier run, with a file of the user in it."""
    for name in ("run.json", "table.parquet", "notes.txt"):
        (tmp_path / name).write_text("earlier")
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "0").write_text("earlier")
    return tmp_path


def _names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {".percept-lock"}


def test_force_removes_the_outputs_of_the_earlier_run_and_nothing_else(finished: Path) -> None:
    with RunFolder(finished, force=True, outputs=("table.parquet", "parts")) as folder:
        assert len(_names(finished)) == 4  # until the input has turned out to be usable
        folder.begin()
        assert _names(finished) == {"notes.txt"}


def test_a_run_that_goes_on_keeps_what_it_has(finished: Path) -> None:
    (finished / "run.json").unlink()
    with RunFolder(finished, resume=True, outputs=("table.parquet", "parts")) as folder:
        folder.begin()
        assert _names(finished) == {"notes.txt", "table.parquet", "parts"}


def test_one_run_at_a_time_writes_a_folder(tmp_path: Path) -> None:
    with RunFolder(tmp_path), pytest.raises(UsageError, match="in use by another run"):
        RunFolder(tmp_path)
    with RunFolder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_run_json_holds_what_was_said_and_the_exit_code_of_the_verdict(tmp_path: Path) -> None:
    log = tmp_path / "a.bag"
    log.write_bytes(b"abc")
    with RunFolder(tmp_path / "run") as folder:
        content = folder.finish(
            config={"a": 1}, inputs=[log], counts={"frames": 2}, dropped={"x": 3},
            verdict=Verdict.BAD, why=["no scan"],
        )  # fmt: skip
    assert json.loads((tmp_path / "run" / "run.json").read_text()) == content
    assert (content["verdict"], content["exit_code"], content["why"]) == ("bad", 4, ["no scan"])
    (described,) = content["inputs"]
    assert (described["path"], described["bytes"]) == (str(log), 3)
