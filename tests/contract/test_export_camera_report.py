"""The camera part of a detection report says what the networks found, and nothing breaks out."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_images import make_image

from percept.core.results import Verdict
from percept.detection.result import ImageResult
from percept.export.camera_report import CameraReport
from percept.export.camera_summary import CameraSummary
from percept.export.detection_report import detection_report
from percept.export.detection_summary import DetectionSummary
from percept.export.finished import image_of
from percept.export.journal import ImageJournal
from percept.export.report import Paragraph, Picture, ReportContent, Table, write_report
from percept.lidar.result import ScanResult

_HOSTILE = "<script>alert('car')</script>"
_NEAR = {
    "path": "near.onnx",
    "layout": "v8",
    "input_size": [640, 384],
    "pixels": "rgb1",
    "fit": "centre",
    "class_count": 80,
    "device": "cpu",
    "device_note": "runs on the processor",
    "why": ["84 rows are 4 and 80 classes"],
    "every": 1,
}


@pytest.fixture(scope="module")
def images() -> list[ImageResult]:
    """Twenty images of two cameras; the far network looks at every fifth, and one is broken."""
    found = []
    for i in range(20):
        camera, models = ("front", "left")[i % 2], ("near", "far") if i % 5 == 0 else ("near",)
        failure = "the JPEG is cut" if i == 7 else None
        found.append(make_image(i, camera=camera, models=models, failure=failure))
    return found


@pytest.fixture(scope="module")
def summary(images: list[ImageResult]) -> CameraSummary:
    gathered = CameraSummary(("near", "far"))
    for image in images:
        gathered.add(image)
    return gathered


def _part(summary: CameraSummary) -> CameraReport:
    return CameraReport(
        summary=summary,
        models={"near": _NEAR, "far": {**_NEAR, "every": 5, "rectangles": True}},
        warnings=["near found nothing with bgr255"],
        wall_s=2.0,
        workers=2,
    )


def _report(summary: CameraSummary, scans: DetectionSummary | None = None) -> ReportContent:
    return detection_report(
        scans or DetectionSummary(),
        title="Detection",
        verdict=Verdict.GOOD,
        why=[],
        advice=[],
        inputs=[],
        settings={},
        cameras=_part(summary),
    )


def _tables(content: ReportContent, title: str) -> list[Table]:
    section = next(section for section in content.sections if section.title == title)
    return [block for block in section.blocks if isinstance(block, Table)]


def test_counts_are_those_of_the_images(summary: CameraSummary, images: list[ImageResult]) -> None:
    assert (summary.images, summary.failed, summary.judged) == (20, 1, 20)
    assert summary.boxes == sum(len(f) for image in images for f in image.boxes.values())
    assert summary.failures == {"image of left: the JPEG is cut": 1}
    assert summary.labels()["far"] == {
        camera: {"car": 2, "pedestrian": 2, "deer": 2} for camera in ("front", "left")
    }
    near = summary.totals["front", "near"]
    assert (near.images, near.boxes, near.duplicates) == (10, 30, 0)
    assert near.sources == {"cluster": 10, "": 10, "depth": 10}
    assert summary.totals["front", "far"].duplicates == 2
    assert near.stages["total"].quantile_ms(1.0) == pytest.approx(27, rel=0.01)
    assert {name: dict(t.sizes) for name, t in summary.cameras.items()} == {
        "front": {"800x450": 10},
        "left": {"800x450": 9},
    }
    ranges_m = np.concatenate([i.positions["near"].range_m for i in images if i.boxes])
    counted = sum(counts[1] for counts in summary.ranges.values())
    assert counted == np.count_nonzero((ranges_m >= 10) & (ranges_m < 20)) > 0


def test_duplicates_are_not_counted_twice_by_range() -> None:
    summary = CameraSummary(("near",))
    image = make_image(0, models=("near",))
    summary.add(replace(image, primary={"near": np.array([False, True, True])}))
    assert sum(counts.total() for counts in summary.ranges.values()) == 1


def test_every_camera_is_pictured_where_most_networks_looked(summary: CameraSummary) -> None:
    captions = [picture.caption for picture in summary.pictures]
    assert {caption.split(",")[0] for caption in captions} == {
        "Image 0 of front", "Image 10 of front", "Image 15 of left", "Image 5 of left",
        "Image 1 of left",
    }  # fmt: skip
    data = summary.pictures[0].data_uri.removeprefix("data:image/jpeg;base64,")
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] == 800


def test_a_journal_gives_the_same_figures(
    summary: CameraSummary, images: list[ImageResult], tmp_path: Path
) -> None:
    again = CameraSummary(("near", "far"))
    with ImageJournal(tmp_path / "j", "x") as journal:
        for image in images:
            journal.append(image)
        for finished, rows in journal.read():
            again.add_finished(finished, image_of(finished, rows))
    assert (again.images, again.failed, again.boxes) == (20, 1, summary.boxes)
    assert again.labels() == summary.labels()
    assert (again.ranges, again.failures) == (summary.ranges, summary.failures)
    assert (again.judged, again.pictures) == (0, ())
    ours, theirs = (_report(s).sections for s in (again, summary))
    assert ours[1] == theirs[1]  # what was found
    assert isinstance(ours[0].blocks[0], Paragraph)


def test_strange_reasons_and_sizes_do_not_fill_the_memory() -> None:
    summary = CameraSummary(("near",))
    for i in range(200):
        summary.add(make_image(i, failure=f"byte {i} is wrong"))
        summary.add(make_image(i, models=(), size=(20 + i, 20)))
    assert len(summary.failures) <= 51
    assert summary.failures.total() == summary.failed == 200
    assert len(summary.cameras["front"].sizes) <= 51


def test_the_report_says_what_matters(summary: CameraSummary) -> None:
    content = _report(summary)
    assert content.subtitle.startswith("20 images and 69 boxes")
    titles = [section.title for section in content.sections]
    assert titles[:4] == [
        "Seen by the cameras",
        "Found in the images",
        "Speed of the networks",
        "How the networks are read",
    ]
    assert "Seen from above" not in titles  # there were no scans
    assert any(isinstance(block, Picture) for block in content.sections[0].blocks)
    classes, positions, cameras = _tables(content, "Found in the images")
    assert classes.header == ("network", "class", "boxes", "front", "left")
    assert ("near", "car", "19", "10", "9") in classes.rows
    assert positions.rows[0] == ("near", "57", "33%", "33%", "33%", "0%")
    assert positions.rows[1][-1] == "33%"
    assert cameras.rows[1][:4] == ("left", "10", "1", "800x450")
    (speed,) = _tables(content, "Speed of the networks")
    rows = {row[:2]: row[2:] for row in speed.rows}
    assert rows["far", "left"][:3] == ("2", "5", "up to 640x384")
    assert rows["near", "front"][:4] == ("10", "1", "640x384", "4.0 / 4.0")
    network_ms = [float(text) for text in rows["near", "front"][5].split(" / ")]
    assert network_ms == pytest.approx([22, 24], rel=0.01)
    assert float(rows["near", "front"][-1]) == pytest.approx(1000 / 25, rel=0.01)
    text = next(b.text for b in content.sections[2].blocks if isinstance(b, Paragraph))
    assert "20 images in 2.0 s with 2 at a time: 10.0 images/s" in text
    models, reasons = _tables(content, "How the networks are read")
    assert models.rows[0] == (
        "near", "near.onnx", "640x384", "v8", "rgb1", "centre", "80", "cpu",
    )  # fmt: skip
    assert ("near", "84 rows are 4 and 80 classes") in reasons.rows
    dropped = _tables(content, "What was left out")[0]
    assert dropped.rows == (("image of left: the JPEG is cut", "1"),)


def test_scans_and_images_share_a_report(
    summary: CameraSummary, make_scan: Callable[..., ScanResult]
) -> None:
    scans = DetectionSummary()
    scans.add(0, make_scan(0))
    content = _report(summary, scans)
    assert [section.title for section in content.sections][:5:3] == [
        "Seen from above",
        "Seen by the cameras",
    ]
    assert "1 scans and 3 objects, 20 images and 69 boxes" in content.subtitle


def test_names_from_strangers_cannot_break_out(tmp_path: Path) -> None:
    image = make_image(0, camera=_HOSTILE, models=(_HOSTILE,))
    found = replace(image.boxes[_HOSTILE], labels=(_HOSTILE, "\x00\u202e", "deer"))
    summary = CameraSummary((_HOSTILE,))
    summary.add(replace(image, boxes={_HOSTILE: found}))
    summary.add(make_image(1, camera=_HOSTILE, failure=_HOSTILE))
    part = CameraReport(
        summary=summary,
        models={_HOSTILE: {**_NEAR, "why": [_HOSTILE], "layout": _HOSTILE, "path": _HOSTILE}},
        warnings=[_HOSTILE],
        wall_s=1.0,
        workers=1,
    )
    content = detection_report(
        DetectionSummary(), title="x", verdict=Verdict.GOOD, why=[], advice=[], inputs=[],
        settings={}, cameras=part,
    )  # fmt: skip
    write_report(tmp_path / "report.html", content)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script" not in text
    assert text.count("&lt;script&gt;") > 8
    for start in text.split("data:image/svg+xml;base64,")[1:]:
        assert b"<script" not in base64.b64decode(start.split('"')[0])


def test_a_run_that_finds_nothing_has_a_report(tmp_path: Path) -> None:
    summary = CameraSummary(("near",))
    summary.add(make_image(0, models=("near",), boxes=0))
    content = _report(summary)
    write_report(tmp_path / "report.html", content)
    assert "No network found anything." in (tmp_path / "report.html").read_text(encoding="utf-8")
    empty = _report(CameraSummary(()))
    assert empty.subtitle == "no scans and no images"
    write_report(tmp_path / "report.html", empty)


def test_rare_classes_share_a_bar() -> None:
    summary = CameraSummary(("near",))
    image = make_image(0, models=("near",), boxes=30)
    labels = tuple(f"kind {row // 2}" for row in range(30))
    found = replace(image.boxes["near"], labels=labels)
    summary.add(replace(image, boxes={"near": found}))
    section = _report(summary).sections[1]
    chart = next(block for block in section.blocks if isinstance(block, Picture))
    svg = base64.b64decode(chart.data_uri.split(",")[1]).decode()
    assert sum(f">kind {k}</text>" in svg for k in range(15)) == 8
    assert ">others</text>" in svg
