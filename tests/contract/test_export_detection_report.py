"""The report of a detection run says what the run found, and stays small."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from percept.core.results import Verdict
from percept.export.detection_report import detection_report, installed_versions
from percept.export.detection_summary import DetectionSummary, band_name
from percept.export.finished import detections_of
from percept.export.journal import FrameJournal
from percept.export.report import Paragraph, Picture, ReportContent, Table, write_report
from percept.lidar.result import ScanResult

MakeScan = Callable[..., ScanResult]


@pytest.fixture(scope="module")
def scans(make_scan: MakeScan) -> list[ScanResult]:
    return [make_scan(i, boxes=6, sensor=("top", "left")[i % 2]) for i in range(20)]


@pytest.fixture(scope="module")
def summary(scans: list[ScanResult]) -> DetectionSummary:
    gathered = DetectionSummary()
    for i, scan in enumerate(scans):
        gathered.add(i, scan)
    return gathered


def _report(summary: DetectionSummary) -> ReportContent:
    return detection_report(
        summary,
        title="Detection on <drive>",
        verdict=Verdict.DOUBTFUL,
        why=["the log was cut"],
        advice=["recover it"],
        inputs=[{"path": "drive.mcap", "bytes": 1_234_567}],
        settings={"ground": {"max_slope": 0.15}, "sensors": ["top", "left"]},
        losses={"chunks that fail their checksum": 2},
        notes=["The 3D view draws every frame."],
    )


def _tables(content: ReportContent) -> dict[str, Table]:
    return {
        section.title: block
        for section in content.sections
        for block in reversed(section.blocks)
        if isinstance(block, Table)
    }


def _pairs(table: Table) -> dict[str, str]:
    return {row[0]: row[1] for row in table.rows}


def test_counts_are_those_of_the_scans(summary: DetectionSummary, scans: list[ScanResult]) -> None:
    assert (summary.frames, summary.objects) == (20, 120)
    assert summary.labels == {"car": 40, "pedestrian": 40, "unknown": 40}
    ranges = np.concatenate([np.hypot(*s.detections.boxes_m[:, :2].T) for s in scans])
    near = sum(counts[1] for counts in summary.ranges.values())
    assert near == np.count_nonzero((ranges >= 10) & (ranges < 20))
    assert summary.dropped == {"points out of range": sum(i % 3 for i in range(20))}
    assert summary.stages["cluster"].quantile_ms(0.5) == pytest.approx(12, rel=0.01)
    assert summary.stages["total"].quantile_ms(1.0) == pytest.approx(20.5, rel=0.01)
    assert (summary.first_ns, summary.last_ns) == (
        scans[0].detections.stamp_ns,
        scans[-1].detections.stamp_ns,
    )
    assert {sensor: len(points) for sensor, points in summary.timelines.items()} == {
        "top": 10,
        "left": 10,
    }


def test_far_objects_share_the_last_band() -> None:
    assert [band_name(band) for band in (0, 3, 10)] == ["0-10 m", "30-40 m", "over 100 m"]


def test_each_sensor_is_pictured(summary: DetectionSummary) -> None:
    captions = [picture.caption for picture in summary.pictures]
    assert [("of top" in c, "of left" in c) for c in captions] == [(True, False)] * 2 + [
        (False, True)
    ] * 2


def test_a_journal_gives_the_same_figures(
    summary: DetectionSummary, scans: list[ScanResult], tmp_path: Path
) -> None:
    again = DetectionSummary()
    with FrameJournal(tmp_path / "j", "x") as journal:
        for i, scan in enumerate(scans):
            journal.append(i, scan)
        for finished, rows in journal.read():
            again.add_finished(finished, detections_of(finished, rows))
    assert again.sensors == summary.sensors
    assert again.ranges == summary.ranges
    assert again.dropped == summary.dropped
    assert again.timelines == summary.timelines
    assert again.pictures == ()
    first = _report(again).sections[0]
    assert "before the run was resumed" in next(
        block.text for block in first.blocks if isinstance(block, Paragraph)
    )


def test_the_report_says_what_matters(summary: DetectionSummary, tmp_path: Path) -> None:
    content = _report(summary)
    tables = _tables(content)
    assert _pairs(tables["What was left out"]) == {
        "points out of range": "19",
        "chunks that fail their checksum": "2",
    }
    assert tables["What was found"].rows[0][:2] == ("car", "40")
    assert tables["Inputs"].rows == (("drive.mcap", "1,234,567"),)
    assert _pairs(tables["Settings"]) == {
        "ground.max_slope": "0.15",
        "sensors": "['top', 'left']",
    }
    assert _pairs(tables["Versions"])["rerun-sdk"].startswith("0.41")
    assert tables["Time by stage"].rows[-1][0] == "total"
    assert any(isinstance(b, Picture) for b in content.sections[0].blocks)
    path = tmp_path / "report.html"
    write_report(path, content)
    text = path.read_text(encoding="utf-8")
    assert "Detection on &lt;drive&gt;" in text
    assert text.index("the log was cut") < text.index("recover it") < text.index("<figure>")
    assert "The 3D view draws every frame." in text


def test_a_run_without_scans_has_a_report(tmp_path: Path) -> None:
    content = _report(DetectionSummary())
    assert content.subtitle == "no scans"
    write_report(tmp_path / "report.html", content)
    assert "no scans to draw" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_versions_name_what_results_depend_on() -> None:
    assert {"Python", "system", "numpy", "rerun-sdk", "percept-toolkit"} <= set(
        installed_versions()
    )
