"""`percept dataset prepare` on logs and folders that are not as they should be."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from made_street_logs import START_NS, write_street_log
from onnx_graphs import KnownBoxes, yolo_graph
from typer.testing import Result

from percept.core.samples import CameraImage, GnssFix, Sample
from percept.datasets import open_recording
from percept.datasets.labelling.set_tables import read_set
from percept.datasets.write import LogFormat, LogWriter

Run = Callable[..., Result]


def _prepare(run: Run, out: Path, logs: Any, *more: object) -> Path:
    bags = [word for log in logs for word in ("--bag", log)]
    result = run("dataset", "prepare", *bags, "--out", out, "--format", "coco,yolo", *more)
    assert result.exit_code == 0, result.output
    return out


def _rows(out: Path, name: str = "frames") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.read_table(out / f"{name}.parquet").to_pylist()
    return rows


def _rewritten(log: Path, out: Path, change: Callable[[Sample], Sample]) -> Path:
    """Write a log again with other samples."""
    kind: LogFormat = "rosbag1" if out.suffix == ".bag" else "mcap"
    with open_recording(log) as recording, LogWriter(out, kind, images="jpeg") as writer:
        for sample in recording.samples():
            writer.write(change(sample))
    return out


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of 20 s."""
    return write_street_log(tmp_path_factory.mktemp("short") / "short.mcap", metres=200)


def _choice(out: Path) -> dict[tuple[str, str, int], tuple[str, str]]:
    return {
        (row["log"], row["camera"], row["stamp_ns"]): (row["split"], row["file"])
        for row in _rows(out)
    }


def test_a_log_added_anywhere_changes_nothing_of_the_others(run: Run, tmp_path: Path) -> None:
    """As for drives that a program made: all begin at one time, on different streets."""
    made = [
        write_street_log(
            tmp_path / f"{n}.mcap", from_m=200.0 * n, metres=150, rate_hz=10, speed_mps=8.0 + n
        )
        for n in range(4)
    ]
    old = _choice(_prepare(run, tmp_path / "old", made[:3]))
    for order in ((0, 1, 2, 3), (3, 0, 1, 2), (2, 3, 1, 0)):
        out = tmp_path / "-".join(map(str, order))
        new = _choice(_prepare(run, out, [made[n] for n in order]))
        assert {key: new[key] for key in new if key[0] != str(made[3])} == old


def test_of_a_part_that_was_cut_out_of_another_log_nothing_is_there_twice(
    run: Run, short: Path, tmp_path: Path
) -> None:
    part = tmp_path / "part.mcap"
    with open_recording(short) as recording, LogWriter(part, "mcap", images="jpeg") as writer:
        for sample in recording.samples(start_ns=START_NS + round(5.3e9)):
            writer.write(sample)
    out = _prepare(run, tmp_path / "set", [part, short])
    rows = [row for row in _rows(out) if row["log"] == str(part)]
    assert len(rows) <= 1  # its first image, which need not be a keyframe of the other
    dropped = [row["reason"] for row in _rows(out, "dropped") if row["log"] == str(part)]
    assert dropped.count("duplicate") >= 10


@pytest.mark.parametrize("stamp_ns", [0, START_NS])
def test_stamps_that_say_nothing_give_way_to_the_times_of_recording(
    run: Run, short: Path, tmp_path: Path, stamp_ns: int
) -> None:
    log = _rewritten(short, tmp_path / "log.mcap", lambda one: replace(one, stamp_ns=stamp_ns))
    out = _prepare(run, tmp_path / "set", [log])
    whole = _prepare(run, tmp_path / "whole", [short])
    said = json.loads((out / "run.json").read_text())["notes"]
    assert any("header stamps on /front/image say nothing" in note for note in said)
    places = [{(row["stamp_ns"], row["latitude"]) for row in _rows(one)} for one in (out, whole)]
    assert places[0] == places[1]


def test_what_cannot_be_used_is_counted_once(run: Run, short: Path, tmp_path: Path) -> None:
    """Every fifth image is damaged, and each stamp comes twice."""
    number = 0
    log = tmp_path / "log.bag"  # has no checksums

    def change(sample: Sample) -> Sample:
        nonlocal number
        if not isinstance(sample, CameraImage):
            return sample
        number += 1
        return replace(sample, stamp_ns=sample.stamp_ns - (number % 2) * 200_000_000)

    _rewritten(short, log, change)
    with open_recording(log) as recording:
        stamps = Counter(image.stamp_ns for image in recording.samples(topics="/front/image"))
    data = bytearray(log.read_bytes())
    starts = [i for i in range(len(data)) if data[i : i + 3] == b"\xff\xd8\xff"]
    for start in starts[::5]:
        data[start + 300 : start + 1500] = bytes(1200)
    log.write_bytes(data)
    out = _prepare(run, tmp_path / "set", [log])
    document = json.loads((out / "run.json").read_text())
    repeated = sum(stamps.values()) - len(stamps)
    assert document["dropped"]["images whose stamp an earlier image of their camera has"] == (
        repeated
    )
    counts = document["counts"]
    assert counts["images_in_logs"] == sum(stamps.values())
    dropped = [row["reason"] for row in _rows(out, "dropped")]
    assert any("jpeg" in reason for reason in dropped)
    assert sum(document["dropped"].values()) == repeated + len(dropped)
    assert counts["images_looked_at"] == counts["images"] + len(dropped) - dropped.count("margin")
    assert f"{repeated} x images whose stamp" in (out / "README.md").read_text()


def test_resume_goes_on_from_any_point_of_the_end(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While poor images are removed, while files are moved, and before `run.json`."""
    log = write_street_log(tmp_path / "log.mcap", metres=200, stands_s=6, dark=range(20, 26))
    whole = _prepare(run, tmp_path / "whole" / "set", [log])
    report = (whole / "report.html").read_text()
    out = tmp_path / "set"
    words = ("--bag", log, "--format", "coco,yolo", "--out", out)
    for module, name, calls in (
        ("conclude", "_move_out", 0),
        ("conclude.Path", "rename", 5),
        ("conclude.RunFolder", "finish", 0),
    ):
        with monkeypatch.context() as patch:
            target = f"percept.cli.dataset.{module}.{name}"
            patch.setattr(target, _ending_after(calls, target))
            assert run("dataset", "prepare", *words, "--force").exit_code == 2
        assert not (out / "run.json").exists()
        assert run("dataset", "prepare", *words, "--resume").exit_code == 0
        names = {path.relative_to(whole) for path in whole.rglob("*")}
        assert {path.relative_to(out) for path in out.rglob("*")} == names
        assert (out / "frames.parquet").read_bytes() == (whole / "frames.parquet").read_bytes()
        # Pictures of what was left out are in it again.
        again = (out / "report.html").read_text()
        assert again.count("<img") == report.count("<img") > 0


def _ending_after(calls: int, target: str) -> Callable[..., Any]:
    """Return what works so often, and then fails as a disk does."""
    module, _, name = target.rpartition(".")
    owner = pytest.importorskip(module) if module.endswith("conclude") else Path
    works = getattr(owner, name, None)
    done = 0

    def call(*arguments: Any, **named: Any) -> Any:
        nonlocal done
        done += 1
        if done > calls or works is None:
            raise OSError(28, "No space left on device")
        return works(*arguments, **named)

    return call


def test_resume_takes_nobody_elses_files(run: Run, short: Path, tmp_path: Path) -> None:
    mine = tmp_path / "README.md"
    mine.write_text("mine")
    result = run("dataset", "prepare", "--bag", short, "--out", tmp_path, "--resume")
    assert result.exit_code == 2
    assert "holds no interrupted preparation, but README.md" in result.stderr
    assert mine.read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["README.md"]


def test_a_journal_that_a_power_failure_spoilt_is_read_as_far_as_it_is_good(
    run: Run, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "set"
    with monkeypatch.context() as patch:
        patch.setattr("percept.cli.dataset.prepare_run.write_set", _ending_after(0, "x.conclude"))
        run("dataset", "prepare", "--bag", short, "--out", out)
    journal = out / ".unfinished" / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:4]) + bytes(200) + b"\n")
    images = sorted((out / ".unfinished" / "images").iterdir())
    images[0].unlink()
    images[1].write_bytes(b"")
    assert run("dataset", "prepare", "--bag", short, "--out", out, "--resume").exit_code == 0
    whole = _prepare(run, tmp_path / "whole", [short])
    for path in (whole / "images").iterdir():
        assert (out / "images" / path.name).read_bytes() == path.read_bytes()


def test_a_log_without_images_is_refused_where_formats_hold_nothing_else(
    run: Run, short: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    with open_recording(short) as recording, LogWriter(log, "mcap") as writer:
        for fix in recording.samples(topics="/gnss"):
            assert isinstance(fix, GnssFix)
            writer.write(fix)
    for name, said in (("coco", "names none that holds scans"), ("sustech", "neither images nor")):
        out = tmp_path / "set"
        result = run("dataset", "prepare", "--bag", log, "--out", out, "--format", name)
        assert (result.exit_code, said in result.stderr) == (3, True), result.stderr


def test_classes_of_several_networks_are_told_by_their_names(
    run: Run, short: Path, tmp_path: Path
) -> None:
    """Number 0 is a car to one network and a person to the other, which sees two more places."""
    places = {"one": [(40.0, 80.0, 120.0, 200.0)],
              "two": [(160.0, 80.0, 200.0, 220.0), (230.0, 90.0, 310.0, 200.0)]}  # fmt: skip
    words = {"one": "{0: 'car', 1: 'person'}", "two": "{0: 'person', 1: 'car'}"}
    models = []
    for name, boxes in places.items():
        known = KnownBoxes(np.array(boxes), np.arange(len(boxes)), np.full(len(boxes), 0.9))
        file = yolo_graph(
            tmp_path / f"{name}.onnx", "v8", size=(320, 320), class_count=2, known=known,
            metadata={"names": words[name]},
        )  # fmt: skip
        models += ["--model", f"{name}={file}"]
    found = tmp_path / "run"
    result = run("detect", "--bag", short, *models, "--camera-only", "--no-track", "--out", found)
    assert result.exit_code == 0, result.output
    out = tmp_path / "set"
    result = run("dataset", "prepare", "--run", found, "--out", out, "--format", "coco,yolo")
    assert result.exit_code == 0, result.output
    images = len(_rows(out))
    labels = Counter((box["label"], box["source"]) for box in _rows(out, "boxes_2d"))
    expected = {("car", "one"): images, ("pedestrian", "two"): images, ("car", "two"): images}
    assert labels == expected
    names = read_set(out).categories
    assert names == ("car", "pedestrian")
    rows = [
        line.split()
        for file in (out / "yolo" / "labels").rglob("*.txt")
        for line in file.read_text().splitlines()
    ]
    assert Counter(names[int(row[0])] for row in rows) == {
        "car": 2 * images, "pedestrian": images
    }  # fmt: skip
