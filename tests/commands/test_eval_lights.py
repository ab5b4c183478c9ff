"""`percept eval lights` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import Result

Run = Callable[..., Result]

STEP_NS = 100_000_000
LIGHTS = (99_100_000_000, 99_100_000_001)


def table(folder: Path, states: dict[int, list[str]], *, seen: bool = True) -> Path:
    """Write `lights.parquet` of lights at 10 Hz."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [
        {"stamp_ns": k * STEP_NS, "light_id": light, "state": words[k].strip("!"),
         "flashing": "!" in words[k], "probability": 0.9, "cameras": "cam_front" if seen else ""}
        for k in range(40)
        for light, words in states.items()
        if words[k]
    ]  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows), folder / "lights.parquet")
    return folder


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    states = {LIGHTS[0]: ["green"] * 20 + ["red"] * 20, LIGHTS[1]: ["red!"] * 40}
    table(tmp_path / "drive" / "truth", states)
    return tmp_path / "drive"


@pytest.fixture
def results(tmp_path: Path) -> Path:
    found = {
        LIGHTS[0]: ["unknown"] * 2 + ["green"] * 20 + ["red"] * 18,
        LIGHTS[1]: [""] * 4 + ["red"] * 10 + ["red!"] * 26,
    }
    return table(tmp_path / "run", found)


def test_a_run_against_the_truth(run: Run, results: Path, truth: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("eval", "lights", results, "--labels", truth, "--out", out)
    assert done.exit_code == 0, done.output
    assert "80 moments at which a camera sees a light; 72 right, 2 unknown, 4 of" in done.stdout
    assert "red read as green: 2" in done.stdout
    assert "flashing lights: 1, found after 1.00 s (median)" in done.stdout
    assert "steady lights said to flash: 0 of 1" in done.stdout
    assert "verdict: doubtful" in done.stdout
    scores = json.loads((out / "scores.json").read_text())
    assert scores["red_as_green"] == 2
    assert scores["delay_median_s"] == pytest.approx(0.25)
    assert scores["by_light"][str(LIGHTS[1])]["unreported"] == 4
    ended = json.loads((out / "run.json").read_text())
    assert ended["verdict"] == "doubtful"
    assert len(ended["inputs"]) == 2
    page = (out / "report.html").read_text()
    assert "Traffic lights against labels" in page
    assert str(LIGHTS[0]) in page


def test_json_is_one_document(run: Run, results: Path, truth: Path) -> None:
    done = run("eval", "lights", results, "--labels", truth / "truth", "--json")
    document = json.loads(done.stdout)
    assert (document["lights"], document["moments"], document["verdict"]) == (2, 80, "doubtful")


def test_images_without_a_light_are_part_of_the_run(run: Run, truth: Path, tmp_path: Path) -> None:
    found = table(tmp_path / "run", {LIGHTS[0]: [""] * 30 + ["red"] * 10})
    sides = ("eval", "lights", found, "--labels", truth, "--json")
    short = json.loads(run(*sides).stdout)
    assert (short["moments"], short["unreported"]) == (20, 10)
    rows = [
        {"frame": k, "stamp_ns": k * STEP_NS, "camera": "c", "model": "m", "failure": None}
        for k in range(40)
    ]
    pq.write_table(pa.Table.from_pylist(rows), found / "images_2d.parquet")
    whole = json.loads(run(*sides).stdout)
    assert (whole["moments"], whole["unreported"]) == (80, 70)


def test_a_run_without_a_map_cannot_be_scored(run: Run, truth: Path, tmp_path: Path) -> None:
    found = table(tmp_path / "run", {1: ["red"] * 40, 2: ["green"] * 40})
    done = run("eval", "lights", found, "--labels", truth)
    assert done.exit_code == 3
    assert done.stderr.count("\n") == 1
    assert "Detect with --map" in done.stderr


def test_nothing_that_a_camera_sees_ends_with_4(run: Run, results: Path, tmp_path: Path) -> None:
    unseen = table(tmp_path / "unseen", {LIGHTS[0]: ["red"] * 40}, seen=False)
    done = run("eval", "lights", results, "--labels", unseen)
    assert done.exit_code == 4
    assert "no moment at which a camera sees a light" in done.stdout


def test_missing_and_damaged_tables_are_said_in_one_line(
    run: Run, results: Path, truth: Path, tmp_path: Path
) -> None:
    for found, labels in ((tmp_path, truth), (results, tmp_path)):
        done = run("eval", "lights", found, "--labels", labels)
        assert done.exit_code == 3
        assert done.stderr.count("\n") == 1
        assert "lights.parquet: there is no such table" in done.stderr
    (results / "lights.parquet").write_bytes(b"PAR1 and nothing more")
    done = run("eval", "lights", results, "--labels", truth)
    assert done.exit_code == 3
    assert "cannot be read as Parquet" in done.stderr
