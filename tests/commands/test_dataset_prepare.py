"""`percept dataset prepare` as a user runs it: logs of one street, and what can go wrong."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
from made_street_logs import ORIGIN, START_NS, write_street_log
from numpy.typing import NDArray
from typer.testing import Result

from percept.core.samples import CameraImage
from percept.datasets import open_recording
from percept.datasets.labelling.set_tables import read_set
from percept.datasets.write import LogWriter

Run = Callable[..., Result]

_COLUMNS = ("frame", "log", "stamp_ns", "camera", "file", "split", "latitude", "longitude")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Drives along the street: `again` repeats a part of `first`, `last` has poor images."""
    folder = tmp_path_factory.mktemp("logs")
    return {
        "first": write_street_log(folder / "first.mcap", metres=600),
        "again": write_street_log(
            folder / "again.mcap", from_m=500, metres=400, start_s=1000, stands_s=6
        ),
        "last": write_street_log(
            folder / "last.mcap",
            from_m=1000,
            metres=800,
            start_s=2000,
            blurred=range(100, 106),
            dark=range(200, 206),
        ),
    }


@pytest.fixture(scope="module")
def prepared(run: Run, logs: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The set of all three logs."""
    return _prepare(run, tmp_path_factory.mktemp("prepared") / "set", logs.values())


def _prepare(run: Run, out: Path, logs: Any, *more: object) -> Path:
    bags = [word for log in logs for word in ("--bag", log)]
    result = run("dataset", "prepare", *bags, "--out", out, "--format", "coco,yolo", *more)
    assert result.exit_code == 0, result.output
    return out


def _rows(out: Path, name: str = "frames") -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.read_table(out / f"{name}.parquet").to_pylist()
    return rows


def _pixels(path: Path) -> NDArray[np.uint8]:
    pixels = cv2.imread(str(path))
    assert pixels is not None
    return np.asarray(pixels, np.uint8)


def test_the_tables_name_files_that_are_there_and_nothing_is_left_over(prepared: Path) -> None:
    rows = _rows(prepared)
    assert set(_COLUMNS) <= rows[0].keys()
    assert [row["frame"] for row in rows] == list(range(len(rows)))
    assert {row["file"] for row in rows} == {
        f"images/{path.name}" for path in (prepared / "images").iterdir()
    }
    for row in rows[::20]:
        assert _pixels(prepared / row["file"]).shape == (96, 160, 3)
    names = {path.name for path in prepared.iterdir()}
    assert {"README.md", "report.html", "run.json", "dropped.parquet", "coco", "yolo"} <= names
    assert not [name for name in names if name.startswith(".")]


def test_images_are_the_recorded_files_and_logs_stay_as_they_were(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    before = logs["first"].read_bytes()
    out = _prepare(run, tmp_path / "set", [logs["first"]])
    assert logs["first"].read_bytes() == before
    row = _rows(out)[3]
    with open_recording(logs["first"]) as recording:
        image = next(
            sample
            for sample in recording.samples(topics=["/front/image"])
            if sample.stamp_ns == row["stamp_ns"]
        )
    assert isinstance(image, CameraImage)
    assert (out / row["file"]).read_bytes() == image.file


def test_no_place_of_one_split_is_nearer_than_the_margin_to_another(
    run: Run, logs: dict[str, Path], prepared: Path, tmp_path: Path
) -> None:
    wide = _prepare(run, tmp_path / "wide", logs.values(), "--margin", "45", "--cell", "120")
    for out, margin_m in ((prepared, 20.0), (wide, 45.0)):
        rows = _rows(out)
        places = ORIGIN.local(
            np.array([[row["latitude"], row["longitude"], ORIGIN.altitude_m] for row in rows])
        )[:, 0]
        splits = np.array([row["split"] for row in rows])
        present = sorted(set(splits))
        assert len(present) > 1
        least = min(
            np.abs(places[splits == a][:, None] - places[splits == b][None]).min()
            for a, b in combinations(present, 2)
        )
        assert least >= margin_m
        # Not wider than it has to be: places are 5 m apart.
        assert least <= margin_m + 15


def test_old_images_keep_their_split_when_a_log_is_added(
    run: Run, logs: dict[str, Path], prepared: Path, tmp_path: Path
) -> None:
    fewer = _prepare(run, tmp_path / "fewer", [logs["again"], logs["first"]])
    old = {(row["log"], row["camera"], row["stamp_ns"]): row["split"] for row in _rows(fewer)}
    new = {(row["log"], row["camera"], row["stamp_ns"]): row["split"] for row in _rows(prepared)}
    assert old
    assert {key: new[key] for key in old} == old


def test_images_that_another_log_repeats_are_all_found(
    run: Run, logs: dict[str, Path], prepared: Path, tmp_path: Path
) -> None:
    originals = [row["file"] for row in _rows(prepared)][::6]
    with LogWriter(tmp_path / "copied.mcap", "mcap", images="jpeg") as log:
        for number, name in enumerate(originals):
            # Darker, a little smaller, and encoded once more.
            pixels = (_pixels(prepared / name) * 0.9).astype(np.uint8)
            stamp_ns = START_NS + 9000 * 10**9 + number * 3 * 10**9
            log.write(
                CameraImage(
                    topic="/other/image",
                    stamp_ns=stamp_ns,
                    log_time_ns=stamp_ns,
                    pixels=np.asarray(cv2.resize(pixels, (150, 90))),
                )
            )
    out = _prepare(run, tmp_path / "set", [*logs.values(), log.path])
    dropped = [row for row in _rows(out, "dropped") if row["log"] == str(log.path)]
    assert [(row["reason"], row["of"]) for row in dropped] == [
        ("duplicate", name) for name in originals
    ]
    assert {row["file"] for row in _rows(out)} == {row["file"] for row in _rows(prepared)}


def test_what_stands_or_is_poor_is_left_out_and_listed(
    logs: dict[str, Path], prepared: Path
) -> None:
    dropped = _rows(prepared, "dropped")
    reasons = Counter(row["reason"] for row in dropped if row["log"] == str(logs["last"]))
    assert reasons["blurred"] >= 2
    assert reasons["under-exposed"] >= 2
    since_ns = START_NS + round(1041e9)
    standing = [
        row
        for row in (*_rows(prepared), *dropped)
        if row["log"] == str(logs["again"]) and row["stamp_ns"] > since_ns
    ]
    assert Counter(row.get("reason") for row in standing)["duplicate"] >= len(standing) - 1 >= 2


def test_a_budget_is_kept(run: Run, logs: dict[str, Path], tmp_path: Path) -> None:
    out = _prepare(run, tmp_path / "set", [logs["first"]], "--frames", "12")
    assert len(_rows(out)) == 12
    assert {row["reason"] for row in _rows(out, "dropped")} >= {"budget"}
    document = json.loads((out / "run.json").read_text())
    assert document["counts"]["images"] == 12


def test_two_runs_give_the_same_bytes(run: Run, logs: dict[str, Path], prepared: Path) -> None:
    other = _prepare(run, prepared.parent / "other", logs.values())
    for name in ("frames.parquet", "keyframes.parquet", "dropped.parquet"):
        assert (other / name).read_bytes() == (prepared / name).read_bytes()


def test_a_folder_that_is_there_is_not_written_over(
    run: Run, logs: dict[str, Path], prepared: Path
) -> None:
    before = {path: path.stat().st_mtime_ns for path in prepared.rglob("*")}
    result = run("dataset", "prepare", "--bag", logs["first"], "--out", prepared)
    assert result.exit_code == 2
    assert "is not empty" in result.stderr
    assert {path: path.stat().st_mtime_ns for path in prepared.rglob("*")} == before


def test_formats_in_space_are_refused_where_the_calibration_is_not_known(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    formats = "kitti,kitti-tracking,nuscenes,sustech"
    out = tmp_path / "set"
    bag = ("--bag", logs["first"])
    result = run("dataset", "prepare", *bag, "--out", out, "--format", f"coco,{formats}")
    assert result.exit_code == 0
    for name in formats.split(","):
        said = next(line for line in result.stderr.splitlines() if f"{name} is not written" in line)
        assert "percept calib" in said
        assert not (out / name).exists()
    assert (out / "coco").is_dir()
    document = json.loads((out / "run.json").read_text())
    assert document["verdict"] == "doubtful"
    result = run("dataset", "prepare", *bag, "--out", tmp_path / "none", "--format", formats)
    assert result.exit_code == 3
    assert len(result.stderr.strip().splitlines()) == 1


def test_names_from_the_log_lead_nowhere(run: Run, tmp_path: Path) -> None:
    inside = tmp_path / "deep" / "er"
    inside.mkdir(parents=True)
    topics = ("/../../étc/пасс wd", "/a/b", "/a_b", "/CON", "/<script>alert(1)</script>")
    log = write_street_log(inside / "../../ein Lauf, ß.mcap", metres=30, topics=topics)
    formats = "coco,yolo,cvat,label-studio,openlabel,parquet"
    out = inside / "set"
    result = run("dataset", "prepare", "--bag", log, "--out", out, "--format", formats)
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["deep", "ein Lauf, ß.mcap"]
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["er"]
    assert [path.name for path in inside.iterdir()] == ["set"]
    assert all(path.name.isascii() for path in out.rglob("*"))
    cameras = {row["camera"] for row in _rows(out)}
    assert len(cameras) == len(topics)
    assert len({row["file"] for row in _rows(out)}) == len(_rows(out))
    assert "<script>alert" not in (out / "report.html").read_text()


def test_a_disk_that_is_full_is_said_in_a_line_and_leaves_no_whole_set(
    logs: dict[str, Path], tmp_path: Path
) -> None:
    if os.geteuid() != 0:
        pytest.skip("a small file system can be mounted by root alone")
    out = tmp_path / "small"
    out.mkdir()
    mounted = subprocess.run(
        ["/usr/bin/mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(out)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if mounted.returncode:
        pytest.skip(f"no file system can be mounted here: {mounted.stderr.strip()}")
    try:
        done = subprocess.run(
            [*_COMMAND, "--bag", str(logs["first"]), "--out", str(out / "set")],
            capture_output=True, text=True, timeout=120, check=False,
        )  # fmt: skip
        assert done.returncode == 2, done.stderr
        assert "the disk is full" in done.stderr.splitlines()[-1]
        assert not (out / "set" / "run.json").exists()
        assert not (out / "set" / "coco").exists()
    finally:
        subprocess.run(["/usr/bin/umount", str(out)], check=True)


_COMMAND = [sys.executable, "-m", "percept.cli", "dataset", "prepare"]


def test_an_interrupted_preparation_goes_on_and_ends_the_same(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    whole = _prepare(run, tmp_path / "whole", [logs["last"]], "--every", "0.1")
    out = tmp_path / "out"
    words = ["--bag", str(logs["last"]), "--format", "coco,yolo", "--every", "0.1"]
    process = subprocess.Popen([*_COMMAND, *words, "--out", str(out)], stderr=subprocess.DEVNULL)
    journal = out / ".unfinished" / "journal.jsonl"
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.stat().st_size > 2000):
        assert time.monotonic() < deadline
        assert process.poll() is None, "it ended before it could be interrupted"
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "run.json").exists()
    assert not (out / "frames.parquet").exists()
    begun = len(journal.read_bytes().splitlines())
    result = run("dataset", "prepare", *words, "--out", out)
    assert (result.exit_code, "--resume" in result.stderr) == (2, True)
    result = run("dataset", "prepare", *words[:-1], "0.2", "--out", out, "--resume")
    assert (result.exit_code, "other logs or settings" in result.stderr) == (2, True)
    assert len(journal.read_bytes().splitlines()) == begun
    result = run("dataset", "prepare", *words, "--out", out, "--resume")
    assert result.exit_code == 0, result.output
    for path in sorted((whole / "images").iterdir()):
        assert (out / "images" / path.name).read_bytes() == path.read_bytes()
    assert (out / "frames.parquet").read_bytes() == (whole / "frames.parquet").read_bytes()
    assert len(list((out / "images").iterdir())) == len(list((whole / "images").iterdir()))


def test_a_set_reads_back_and_its_report_and_card_say_what_is_in_it(prepared: Path) -> None:
    labelled = read_set(prepared)
    card = (prepared / "README.md").read_text()
    report = (prepared / "report.html").read_text()
    for drive in labelled.drives:
        assert drive in card
        assert drive in report
    assert "| duplicate |" in card
    assert "margin" in report


def test_what_was_asked_wrongly_is_said_in_a_line(
    run: Run, logs: dict[str, Path], tmp_path: Path
) -> None:
    bag = ("--bag", logs["first"])
    wrong: dict[str, tuple[object, ...]] = {
        "no log was given": (),
        "knows no 'voc'": (*bag, "--format", "coco,voc"),
        "is given twice": (*bag, *bag),
        "cell_m": (*bag, "--margin", "80", "--cell", "100"),
        "is no number": (*bag, "--threshold", "car=high"),
        "two names": (*bag, "--topic", "a=/front/image", "--topic", "b=/front/image"),
        "is not between 0 and 1": (*bag, "--threshold", "car=90"),
        "holds no finished run": ("--run", tmp_path),
        "that fail their checksum": ("--bag", _damaged(logs["first"], tmp_path / "damaged.mcap")),
        "no such file": ("--bag", tmp_path / "nothing.mcap"),
    }
    for said, words in wrong.items():
        result = run("dataset", "prepare", *words, "--out", tmp_path / "set")
        assert result.exit_code in (2, 3, 4), said
        assert said in result.stderr, result.stderr
        assert len(result.stderr.strip().splitlines()) == 1, result.stderr
        assert not (tmp_path / "set").exists()


def _damaged(log: Path, out: Path) -> Path:
    data = bytearray(log.read_bytes())
    for part in range(1, 10):
        data[part * len(data) // 10] ^= 0xFF
    out.write_bytes(data)
    return out
