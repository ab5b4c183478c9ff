"""`percept dataset check` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from made_labelled_set import make_labelled_set
from typer.testing import Result

from percept.datasets.labelling.check.problems import CODES
from percept.datasets.labelling.formats import export

Run = Callable[..., Result]


@pytest.fixture
def prepared(tmp_path: Path) -> Path:
    """A small set of three splits with COCO and YOLO."""
    labelled = make_labelled_set(tmp_path / "set", drives=3, keyframes=1, with_scans=False)
    for name in ("coco", "yolo"):
        export(labelled, name, labelled.folder / name)
    record = {"config": {"split": {"margin_m": 20.0}}}
    (labelled.folder / "run.json").write_text(json.dumps(record))
    return labelled.folder


def test_a_whole_set_is_good(run: Run, prepared: Path) -> None:
    done = run("dataset", "check", prepared)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[-1] == "verdict: good (6 images, nothing is wrong)"
    assert "boxes in images" in done.stdout
    assert "error" not in done.stdout


def test_faults_are_told_by_kind_and_end_with_4(run: Run, prepared: Path, tmp_path: Path) -> None:
    for image in sorted((prepared / "yolo/images/train").iterdir()):
        image.unlink()
    (prepared / "images/more.jpg").write_bytes(b"")
    out = tmp_path / "report"
    done = run("dataset", "check", prepared, "--out", out)
    assert done.exit_code == 4, done.output
    assert "error: 2 x stray-label: labels are there without their image" in done.stdout
    assert "warning: 1 x stray-file" in done.stdout
    assert "what to do: " in done.stdout
    assert done.stdout.index("error:") < done.stdout.index("warning:")
    assert "stray-label" in (out / "report.html").read_text("utf-8")
    said = json.loads((out / "check.json").read_text("utf-8"))
    record = json.loads((out / "run.json").read_text("utf-8"))
    assert (said["verdict"], record["verdict"], record["exit_code"]) == ("bad", "bad", 4)
    assert record["counts"]["problems"] == said["counts"]["problems"]


def test_json_is_one_document(run: Run, prepared: Path) -> None:
    next((prepared / "images").iterdir()).unlink()
    done = run("dataset", "check", prepared, "--json")
    assert done.exit_code == 4
    said = json.loads(done.stdout)
    assert set(said) == {"verdict", "why", "problems", "histogram", "counts"}
    assert said["verdict"] == "bad"
    assert said["why"] == ["1 x missing-file: a file that is named is not there"]
    (problem,) = said["problems"]
    assert (problem["code"], problem["severity"]) == ("missing-file", "error")
    assert said["histogram"]["car"] == {"train": 1, "val": 1, "test": 1}


def test_a_folder_without_a_set_ends_with_3(run: Run, tmp_path: Path) -> None:
    done = run("dataset", "check", tmp_path, "--out", tmp_path / "report")
    assert done.exit_code == 3
    assert "holds no data set that is known" in done.stderr
    assert not (tmp_path / "report").exists()


def test_the_report_may_not_go_into_a_folder_that_is_in_use(run: Run, prepared: Path) -> None:
    before = sorted(path for path in prepared.rglob("*"))
    done = run("dataset", "check", prepared, "--out", prepared)
    assert done.exit_code == 2
    assert sorted(path for path in prepared.rglob("*")) == before


def test_the_manual_lists_every_code() -> None:
    manual = Path(__file__).parents[2] / "docs" / "dataset-check.md"
    rows = [line for line in manual.read_text("utf-8").splitlines() if line.startswith("| `")]
    listed = {row.split("`")[1]: row for row in rows}
    for code, (severity, means, remedy) in CODES.items():
        assert listed[code] == f"| `{code}` | {severity} | {means} | {remedy} |"
