"""Tables with their files: one folder that holds all of a set, wherever it is taken."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from made_labelled_set import make_labelled_set

from percept.datasets.labelling.formats.parquet import export_parquet
from percept.datasets.labelling.set_tables import read_set

_TABLES = ("frames", "keyframes", "boxes_2d", "boxes_3d")


@pytest.mark.parametrize("distorted", [True, False])
def test_all_that_a_set_holds_can_be_taken_elsewhere(tmp_path: Path, *, distorted: bool) -> None:
    made = make_labelled_set(tmp_path / "set", rectified_suffix=".jpg", distorted=distorted)
    out = tmp_path / "out"
    out.mkdir()
    assert export_parquet(made, out) == ()
    moved = out.rename(tmp_path / "moved")
    for name in ("dataset.json", *(f"{table}.parquet" for table in _TABLES)):
        assert (moved / name).read_bytes() == (made.folder / name).read_bytes()
    shutil.rmtree(made.folder / "rectified")
    read = read_set(moved)
    for keyframe, frame in read.frames():
        assert keyframe.scan is not None
        assert frame.rectified_file is not None
        for file in (frame.file, frame.rectified_file, keyframe.scan.file):
            assert (moved / file).stat().st_size > 0
    assert "Nothing." in (moved / "README.md").read_text("utf-8")


def test_files_are_there_without_their_bytes_being_there_twice(tmp_path: Path) -> None:
    made = make_labelled_set(tmp_path / "set", drives=1, keyframes=1)
    out = tmp_path / "out"
    out.mkdir()
    export_parquet(made, out)
    _, frame = next(made.frames())
    assert (out / frame.file).samefile(made.folder / frame.file)


def test_a_set_without_scans_and_rectified_images_is_written(tmp_path: Path) -> None:
    made = make_labelled_set(
        tmp_path / "set", drives=1, keyframes=1, with_scans=False, rectified_suffix=None
    )
    out = tmp_path / "out"
    out.mkdir()
    export_parquet(replace(made, licence="CC0-1.0"), out)
    assert read_set(out).licence == "CC0-1.0"
    assert not (out / "scans").exists()
