"""`percept dataset prepare --anonymise`: the original is nowhere."""

from __future__ import annotations

import json
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


def test_plates_are_unreadable_in_every_file_and_counted(
    run: Callable[..., Result], tmp_path: Path
) -> None:
    log = write_street_log(tmp_path / "log.mcap", metres=40)
    known = KnownBoxes(np.array([_PLATE], float), np.array([0]), np.array([0.9]))
    network = yolo_graph(
        tmp_path / "plates.onnx", "v8", known, class_count=2, size=(160, 96),
        metadata={"names": "{0: 'plate', 1: 'sky'}"},
    )  # fmt: skip
    out = tmp_path / "set"
    result = run(
        "dataset", "prepare", "--bag", log, "--out", out, "--format", "coco,yolo,cvat",
        "--anonymise", "plates", "--anonymise-model", f"plates={network}",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    with open_recording(log) as recording:
        recorded = list(recording.samples(topics=["/front/image"]))
    originals = [sample.file for sample in recorded if isinstance(sample, CameraImage)]
    written = [path for path in out.rglob("*") if path.suffix in (".jpg", ".png")]
    assert len(written) > 10
    x1, y1, x2, y2 = _PLATE
    for path in written:
        assert path.read_bytes() not in originals
        pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert pixels is not None
        steps = np.abs(np.diff(pixels.astype(float), axis=1))
        assert steps[y1:y2, x1 : x2 - 1].mean() < 0.35 * steps[:, : x1 - 12].mean()
    document = json.loads((out / "run.json").read_text())
    assert document["counts"]["blurred"] == {"plates": document["counts"]["images"]}
    assert any(one["path"] == str(network) for one in document["inputs"])
    assert "plates" in (out / "README.md").read_text()
