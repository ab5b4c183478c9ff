"""`percept eval detections` as a user runs it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import Result

from percept.core.results import Detections2D
from percept.detection.result import ImageResult
from percept.export.finished import finished_image
from percept.export.image_table import IMAGES_2D, image_rows
from percept.export.tables import DETECTIONS_2D, detections_2d_table, write_parquet

Run = Callable[..., Result]

_CAR = (100.0, 100.0, 180.0, 150.0)
_DEER = (300.0, 100.0, 340.0, 160.0)
_IMAGES = 120


def _truth(folder: Path, images: int = _IMAGES) -> Path:
    """Write the truth of a drive: a car in each image, a deer in each second one."""
    rows = [
        {"stamp_ns": stamp_ns, "camera": "front", "track_id": k, "label": label, "visible": visible,
         "x1_px": box[0], "y1_px": box[1], "x2_px": box[2], "y2_px": box[3], "range_m": range_m}
        for stamp_ns in range(images)
        for k, (label, box, visible, range_m) in enumerate(
            [("car", _CAR, 1.0, 9.0), ("deer", _DEER, 0.2, 35.0)][: 1 + (stamp_ns % 2 == 0)]
        )
    ]  # fmt: skip
    (folder / "truth").mkdir()
    pq.write_table(pa.Table.from_pylist(rows), folder / "truth" / "boxes_2d.parquet")
    return folder / "truth"


def _run(folder: Path) -> Path:
    """Write a run with two models: `near` sees each image, `far` each fifth, and one is broken."""
    results = [_image(k) for k in range(_IMAGES)]
    (folder / "run").mkdir()
    tables = [detections_2d_table(result) for result in results]
    write_parquet(
        folder / "run" / "detections_2d.parquet",
        DETECTIONS_2D,
        (batch for table in tables for batch in table.to_batches()),
    )
    write_parquet(
        folder / "run" / "images_2d.parquet",
        IMAGES_2D,
        (image_rows(finished_image(result)) for result in results),
    )
    return folder / "run"


def _image(frame: int) -> ImageResult:
    """Return what is found: `near` misses the car in each fourth image; `far` sees deer."""
    found: dict[str, Detections2D] = {"near": _found(frame, ("car", _CAR))}
    if frame % 4 == 3:
        found["near"] = _found(frame)
    if frame % 5 == 0:
        found["far"] = _found(frame, ("deer", _DEER), ("car", _CAR))
    return ImageResult(
        frame=frame,
        camera="front",
        stamp_ns=frame,
        log_time_ns=frame,
        image=None,
        boxes={} if frame == 7 else found,
        primary={"far": np.array([True, frame % 4 == 3])} if frame % 5 == 0 else {},
        timings_ms={} if frame == 7 else {model: {"network": 1.0} for model in found},
        failure="a broken JPEG" if frame == 7 else None,
    )


def _found(stamp_ns: int, *boxes: tuple[str, tuple[float, ...]]) -> Detections2D:
    return Detections2D(
        stamp_ns,
        "front",
        np.array([box for _, box in boxes], dtype=np.float64).reshape(-1, 4),
        tuple(label for label, _ in boxes),
        np.linspace(0.3, 0.9, len(boxes)) + stamp_ns / 10_000,
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("eval")
    return _run(folder), _truth(folder)


def _json(result: Result) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(result.stdout)
    return document


def test_a_run_against_the_truth_of_a_drive(
    run: Run, folders: tuple[Path, Path], tmp_path: Path
) -> None:
    found, truth = folders
    out = tmp_path / "out"
    done = run("eval", "detections", "--detections", found, "--labels", truth, "--out", out)
    assert done.exit_code == 0, done.output
    assert "119 images" in done.stdout  # the broken one was not looked at
    assert "left out: 1 labelled images that the detector did not look at" in done.stdout
    assert "far, near together: 18 that another model found" in done.stdout
    scores = json.loads((out / "scores.json").read_text())
    car, deer = scores["by_class"]["car"], scores["by_class"]["deer"]
    # near finds 90 of 119, far adds those of the 6 images 15, 35, ... that near missed
    assert (car["objects"], car["hits"], car["precision"]) == (119, 96, 1.0)
    assert (deer["objects"], deer["hits"]) == (60, 12)
    assert set(scores["by_range"]) >= {"0-15 m", "30-50 m"}
    ended = json.loads((out / "run.json").read_text())
    assert ended["verdict"] == scores["verdict"]
    assert ended["exit_code"] == 0
    assert ended["config"]["score"] == 0.25
    assert len(ended["inputs"]) == 2
    page = (out / "report.html").read_text()
    assert "data:image/svg+xml" in page
    assert "front/" in page


def test_one_model_is_judged_on_the_images_that_it_saw(
    run: Run, folders: tuple[Path, Path]
) -> None:
    found, truth = folders
    sides = ("--detections", found, "--labels", truth, "--json")
    far = _json(run("eval", "detections", *sides, "--model", "far"))
    assert far["images"] == 24
    assert far["recall"] == 1.0
    near = _json(run("eval", "detections", *sides, "--model", "near"))
    assert near["images"] == 119
    assert near["by_class"]["deer"]["recall"] == 0.0
    assert any("not one detection of deer (60)" in reason for reason in near["why"])
    visible = _json(run("eval", "detections", *sides, "--model", "near", "--min-visible", "0.3"))
    assert visible["objects"] == 119


def test_settings_come_from_a_file_and_flags_win(
    run: Run, folders: tuple[Path, Path], tmp_path: Path
) -> None:
    found, truth = folders
    settings = tmp_path / "eval.yaml"
    settings.write_text("score: 0.5\niou: 0.7\nlabel_map: {deer: animal}\n")
    sides = ("--detections", found, "--labels", truth, "--json", "--config", settings)
    document = _json(run("eval", "detections", *sides, "--iou", "0.6"))
    assert (document["score"], document["iou"]) == (0.5, 0.6)
    assert "animal" in document["by_class"]
    settings.write_text("scroe: 0.5\n")
    done = run("eval", "detections", *sides)
    assert done.exit_code == 2
    assert "Did you mean 'score'" in done.stderr


def test_nothing_to_find_ends_with_4(run: Run, tmp_path: Path) -> None:
    (tmp_path / "label_2").mkdir()
    (tmp_path / "label_2" / "a.txt").write_text(
        "DontCare -1 -1 -10 0 0 9 9 -1 -1 -1 -1000 -1000 -1000 -10\n"
    )
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.txt").write_text("Car 0 0 0 20 20 60 50 1 1 1 0 0 9 0 0.5\n")
    sides = ("--detections", tmp_path / "data", "--labels", tmp_path)
    done = run("eval", "detections", *sides, "--out", tmp_path / "out")
    assert done.exit_code == 4
    assert "verdict: bad" in done.stdout
    assert "nothing to find" in done.stdout
    assert json.loads((tmp_path / "out" / "run.json").read_text())["exit_code"] == 4


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        (["--map", "kite=car"], 2, "neither the labels nor the detections have a class 'kite'"),
        (["--map", "kite"], 2, "not of the form NAME=VALUE"),
        (["--image-size", "640"], 2, "not of the form WxH"),
        (["--iou", "0"], 2, "'iou'"),
        (["--score", "nan"], 2, "'score'"),
        (["--format", "voc"], 2, "--format"),
        (["--model", "middle"], 2, "no model 'middle'"),
        (["--format", "coco"], 3, "is no file"),
        (["--labels-format", "kitti"], 3, "no label files"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    run: Run, folders: tuple[Path, Path], options: list[str], code: int, message: str
) -> None:
    found, truth = folders
    done = run("eval", "detections", "--detections", found, "--labels", truth, *options)
    assert done.exit_code == code, done.output
    assert message in " ".join(done.stderr.split())
    assert not done.stdout


def test_a_folder_that_is_not_empty_is_left_alone(
    run: Run, folders: tuple[Path, Path], tmp_path: Path
) -> None:
    found, truth = folders
    (tmp_path / "mine.txt").write_text("mine")
    sides = ("--detections", found, "--labels", truth, "--out", tmp_path)
    assert run("eval", "detections", *sides).exit_code == 2
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]
    assert run("eval", "detections", *sides, "--force").exit_code == 0
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_yolox_nano_on_a_real_image(run: Run, shared_data: Path, tmp_path: Path) -> None:
    """All 6 labelled cars of KITTI 000008 are found, and 2 more where none is labelled."""
    labels = _kitti_labels(shared_data, tmp_path / "labels")
    found = _kitti_detections(shared_data, tmp_path / "found")
    sides = ("--detections", found, "--labels", labels, "--format", "kitti")
    document = _json(run("eval", "detections", *sides, "--map", "Car=car", "--json"))
    car = document["by_class"]["car"]
    assert (car["objects"], car["detections"], car["hits"]) == (6, 8, 6)
    # Ranked: 5 hits, a false one, a hit: 84 recalls with a precision of 1, 17 with 6/7.
    assert document["ap50"] == pytest.approx((84 + 17 * 6 / 7) / 101, abs=1e-9)
    assert document["by_range"]["0-15 m"]["objects"] == 4
    assert document["verdict"] == "doubtful"
    done = run("eval", "detections", *sides)
    assert done.exit_code == 3
    assert "--map Car=car" in done.stderr


def _kitti_labels(shared_data: Path, folder: Path) -> Path:
    document = json.loads((shared_data / "scenes/kitti_000008/000008.json").read_text())
    lines = []
    for one in document["data_list"][0]["instances"]:
        x, y, z, length, height, width, yaw = one["bbox_3d"]
        name = "Car" if one["bbox_label"] == 2 else "DontCare"
        numbers = (one["truncated"], one["occluded"], one["alpha"], *one["bbox"],
                   height, width, length, x, y, z, yaw)  # fmt: skip
        lines.append(" ".join(map(str, (name, *numbers))))
    folder.mkdir()
    (folder / "000008.txt").write_text("\n".join(lines))
    return folder


def _kitti_detections(shared_data: Path, folder: Path) -> Path:
    document = json.loads((shared_data / "yolo/yolox_nano/reference_detections.json").read_text())
    lines = [
        f"{one['class']} -1 -1 -10 {' '.join(map(str, one['xyxy']))} -1 -1 -1 -1000 -1000 -1000 "
        f"-10 {one['score']}"
        for one in document["detections"]["scenes/kitti_000008/000008.png"]
    ]
    folder.mkdir()
    (folder / "000008.txt").write_text("\n".join(lines))
    return folder
