"""`percept detect quantize`: a smaller network beside the old one, or none and the reason."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lamp_network import lamp_network, lamp_picture, write_lamp_pictures
from onnx_graphs import yolo_graph
from typer.testing import CliRunner, Result

from percept.cli.app import app
from percept.core.samples import CameraImage
from percept.datasets.write import LogWriter
from percept.detection import YoloDetector


def _quantize(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["detect", "quantize", *map(str, arguments)])


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    at = tmp_path_factory.mktemp("quantize")
    lamp_network(at / "lamps.onnx")
    write_lamp_pictures(at / "pictures", 30)
    return at


def test_writes_a_network_that_finds_the_same(place: Path, tmp_path: Path) -> None:
    before = (place / "lamps.onnx").read_bytes()
    out = tmp_path / "small.onnx"
    result = _quantize(
        place / "lamps.onnx", "--calibration", place / "pictures", "--out", out, "--images", 16,
        "--json",
    )  # fmt: skip
    run: dict[str, Any] = json.loads(result.stdout)
    assert result.exit_code == run["exit_code"] == 0
    assert run["out"] == str(out)
    assert run["images"] == {"calibration": 16, "compared": 8}
    assert run["layers"] == {
        "quantized": 3,
        "kept": {"sees pixels": 1, "puts out boxes or scores": 3},
    }
    assert run["agreement"]["boxes_float"] > 30
    assert run["agreement"]["share_iou_75"] == 1.0
    assert run["bytes"] == {
        "float": len(before),
        "int8": out.stat().st_size,
    }
    assert (place / "lamps.onnx").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["small.onnx"]
    found = YoloDetector(out).detect([lamp_picture(99)])[0]
    assert len(found) == len(YoloDetector(place / "lamps.onnx").detect([lamp_picture(99)])[0]) > 0


def test_says_in_words_what_it_did(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = _quantize(place / "lamps.onnx", "--calibration", place / "pictures")
    assert result.exit_code == 0
    assert "3 in integers; as they were: 1 sees pixels, 3 puts out boxes or scores" in result.stdout
    assert "100.0% agree at IoU 0.5" in result.stdout
    assert "verdict: " in result.stdout
    assert (tmp_path / "lamps_int8.onnx").is_file()


def test_what_is_no_picture_is_named(place: Path, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "log.mcap", "mcap", images="png") as log:
        for number in range(24):
            deep = np.full((64, 64), number, np.uint16)
            for topic, pixels in (
                ("/cam", lamp_picture(number)), ("/infrared", deep), ("/depth", deep),
            ):  # fmt: skip
                log.write(
                    CameraImage(topic=topic, stamp_ns=number, log_time_ns=number, pixels=pixels)
                )
    result = _quantize(
        place / "lamps.onnx", "--calibration", tmp_path / "log.mcap", "--out", tmp_path / "a.onnx",
        "--json",
    )  # fmt: skip
    run = json.loads(result.stdout)
    assert run["exit_code"] == 0
    assert list(run["dropped"]) == [
        "images of /infrared (uint16 pixels do not say which value is white)"
    ]
    assert sum(run["dropped"].values()) == 24
    assert sum(run["images"].values()) == 24
    assert run["notes"] == ["the depth images in /depth are left alone"]


def test_a_bad_network_is_not_written(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("percept.detection.agreement.BAD_SHARE_50", 1.01)
    out = tmp_path / "small.onnx"
    result = _quantize(
        place / "lamps.onnx", "--calibration", place / "pictures", "--out", out, "--json"
    )
    run = json.loads(result.stdout)
    assert result.exit_code == run["exit_code"] == 4
    assert run["verdict"] == "bad"
    assert run["out"] is None
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "code", "message"),
    [
        ({"--out": "lamps.onnx"}, 2, "--out is the network itself"),
        ({"--out": "taken.onnx"}, 2, "taken.onnx: it exists. Give another --out, or --force"),
        ({"--out": "nowhere/a.onnx"}, 2, "nowhere: there is no such folder"),
        ({"MODEL": "none.onnx"}, 3, "none.onnx: there is no such file"),
        ({"MODEL": "taken.onnx"}, 3, "taken.onnx: this is not a whole ONNX network"),
        ({"MODEL": "constant.onnx"}, 3, "no layer of it can be quantised"),
        ({"--calibration": "none"}, 3, "none: no such file or folder"),
        ({"--calibration": "one"}, 4, "it has 1 images"),
        ({"--calibration": "dark"}, 4, "the network finds nothing in 2 images"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    place: Path, tmp_path: Path, change: dict[str, str], code: int, message: str
) -> None:
    shutil.copytree(place, tmp_path, dirs_exist_ok=True)
    (tmp_path / "taken.onnx").write_text("mine")
    yolo_graph(tmp_path / "constant.onnx", "v8")
    write_lamp_pictures(tmp_path / "one", 1)
    write_lamp_pictures(tmp_path / "dark", 6, lamps=0)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    given = {"MODEL": "lamps.onnx", "--calibration": "pictures", "--out": "out.onnx", **change}
    paths = {flag: tmp_path / name for flag, name in given.items()}
    options = [word for flag, path in paths.items() if flag != "MODEL" for word in (flag, path)]
    result = _quantize(paths["MODEL"], *options)
    assert result.exit_code == code
    assert result.stderr.startswith("error: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_force_replaces_the_output(place: Path, tmp_path: Path) -> None:
    out = tmp_path / "small.onnx"
    out.write_text("old")
    result = _quantize(
        place / "lamps.onnx", "--calibration", place / "pictures", "--out", out, "--force"
    )
    assert result.exit_code == 0
    assert out.stat().st_size > 3


def test_yolox_nano_on_real_pictures(shared_data: Path, tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    sources = sorted((shared_data / "lane/carnd_p1").glob("*.jpg"))
    sources += sorted((shared_data / "lane/tusimple_lanenet/tusimple_test_image").glob("*.jpg"))
    for number, path in enumerate(sources):
        shutil.copyfile(path, pictures / f"{number}.jpg")
    out = tmp_path / "nano_int8.onnx"
    result = _quantize(
        shared_data / "yolo/yolox_nano/yolox_nano.onnx", "--calibration", pictures, "--out", out,
        "--json",
    )  # fmt: skip
    run = json.loads(result.stdout)
    assert run["layers"]["kept"]["depthwise"] == 30
    assert run["bytes"]["int8"] < 0.4 * run["bytes"]["float"]
    assert run["agreement"]["share_iou_50"] > 0.8
    assert YoloDetector(out).layout.name == "yolox"
