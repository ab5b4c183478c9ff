"""`percept dataset prepare --anonymise`: the original is nowhere."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from made_street_logs import write_street_log
from onnx_graphs import yolo_graph
from onnx_layouts import KnownBoxes
from typer.testing import Result

from percept.core.samples import CameraImage
from percept.datasets import open_recording

_PLATE = (64, 24, 128, 72)
_FORMATS = "coco,yolo,cvat,label-studio,openlabel,parquet"


def _plates(path: Path, box: tuple[int, ...] = _PLATE) -> Path:
    known = KnownBoxes(np.array([box], float), np.array([0]), np.array([0.9]))
    names = {"names": "{0: 'plate', 1: 'sky'}"}
    return yolo_graph(path, "v8", known, class_count=2, size=(160, 96), metadata=names)


def _words(log: Path, network: Path) -> list[str]:
    return [
        "--bag", str(log), "--format", _FORMATS, "--every", "0.1",
        "--anonymise", "plates", "--anonymise-model", f"plates={network}",
    ]  # fmt: skip


def _check(out: Path, log: Path) -> int:
    """Check that nothing of an original is below a folder; return the number of images."""
    with open_recording(log) as recording:
        recorded = list(recording.samples(topics=["/front/image"]))
    files = [one.file for one in recorded if isinstance(one, CameraImage) and one.file is not None]
    assert len(files) == len(recorded)
    # All of one quality begin with the same tables: what tells them apart is the middle.
    originals = [file[len(file) // 2 :][:64] for file in files]
    x1, y1, x2, y2 = _PLATE
    images = 0
    for path in (path for path in out.rglob("*") if path.is_file()):
        content = path.read_bytes()
        assert not [one for one in originals if one in content], path
        pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.suffix == ".jpg" else None
        if pixels is not None:
            images += 1
            steps = np.abs(np.diff(pixels.astype(float), axis=1))
            assert steps[y1:y2, x1 : x2 - 1].mean() < 0.35 * steps[:, : x1 - 12].mean(), path
    return images


def test_plates_are_unreadable_in_every_file_and_counted(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    log, network = write_street_log(tmp_path / "log.mcap", metres=40), _plates(tmp_path / "p.onnx")
    out = tmp_path / "set"
    result = run("dataset", "prepare", *_words(log, network), "--out", out)
    assert result.exit_code == 0, result.output
    document = json.loads((out / "run.json").read_text())
    count = document["counts"]["images"]
    assert _check(out, log) >= 6 * count > 0
    assert document["counts"]["blurred"] == {"plates": count}
    assert any(one["path"] == str(network) for one in document["inputs"])
    assert f"plates: {count} regions" in (out / "README.md").read_text()


def test_a_killed_preparation_leaves_no_original_behind(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    log, network = write_street_log(tmp_path / "log.mcap", metres=400), _plates(tmp_path / "p.onnx")
    out = tmp_path / "set"
    words = ["dataset", "prepare", *_words(log, network), "--out", str(out)]
    command = [sys.executable, "-m", "percept.cli", *words]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    journal = out / ".unfinished" / "journal.jsonl"
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.stat().st_size > 2000):
        assert time.monotonic() < deadline
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    (journal.parent / "images" / "cut.jpg").touch()  # as one that was being written
    assert _check(out, log) >= 2
    _plates(network, (0, 0, 32, 32))
    result = run(*words, "--resume")
    assert (result.exit_code, "other logs or settings" in result.stderr) == (2, True)
    _plates(network)
    assert run(*words, "--resume").exit_code == 0
    assert _check(out, log) > 100
