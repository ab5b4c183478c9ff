"""`percept synth calib` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from percept.core.rig import load_rig
from percept.datasets import open_recording

Run = Callable[..., Result]


@pytest.fixture(scope="module")
def made(run: Run, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    out = tmp_path_factory.mktemp("synth") / "rig"
    return out, run("synth", "calib", "--stops", 1, "--poses", 1, "--out", out, "--json")


def test_it_writes_log_rigs_board_and_truth(made: tuple[Path, Result]) -> None:
    out, result = made
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert document["counts"]["poses"] == 1
    assert document["config"]["format"] == "mcap"
    assert document == json.loads((out / "run.json").read_text())
    names = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    truth = {"truth/rig.yaml", "truth/boards.parquet", "truth/poses.parquet"}
    assert names == {"run.json", "calib.mcap", "rig.yaml", "board.yaml", *truth}
    start, exact = (load_rig(out / name) for name in ("rig.yaml", "truth/rig.yaml"))
    assert start.sensors.keys() == exact.sensors.keys()
    with open_recording(out / "calib.mcap") as recording:
        assert {t.topic: t.count for t in recording.topics()} == document["counts"]["topics"]


def test_lidars_alone_in_another_format(run: Run, tmp_path: Path) -> None:
    result = run(
        "synth", "calib", "--stops", 1, "--poses", 1, "--cameras", "none", "--noise", 0,
        "--format", "rosbag1", "--out", tmp_path / "o",
    )  # fmt: skip
    assert result.exit_code == 0
    assert "1 stops, 0 poses of the board" in result.stdout
    with open_recording(tmp_path / "o" / "calib.bag") as recording:
        topics = {topic.topic for topic in recording.topics()}
    assert "/lidar_front/points" in topics
    assert not [topic for topic in topics if topic.startswith("/cam")]


def test_mistakes_are_usage_errors(run: Run, made: tuple[Path, Result], tmp_path: Path) -> None:
    few = run("synth", "calib", "--stops", 3, "--poses", 2, "--out", tmp_path / "o")
    assert few.exit_code == 2
    assert "2 poses of the board for 3 stops" in few.stderr
    again = run("synth", "calib", "--out", made[0])
    assert again.exit_code == 2
    assert "not empty" in again.stderr
