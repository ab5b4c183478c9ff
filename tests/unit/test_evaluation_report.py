"""The report of a scoring: all figures are in it, and names from strangers stay text."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import pytest

from percept.core.errors import GeometryError
from percept.core.labels import LabelledImage, LabelSet
from percept.evaluation.boxes_2d import score_boxes
from percept.export.charts import share_curves
from percept.export.evaluation_report import box_scores_report
from percept.export.report import write_report

_NASTY = "<script>alert('x')</script>"
_BOX = (10.0, 10.0, 50.0, 60.0)
_OTHER = (100.0, 10.0, 150.0, 60.0)


def _page(folder: Path) -> str:
    truth = LabelledImage.of(_NASTY, [_BOX, _OTHER], [_NASTY, "deer"], range_m=[8, 40])
    found = LabelledImage.of(_NASTY, [_BOX, _OTHER], [_NASTY, _NASTY], [0.9, 0.8])
    scores = score_boxes(LabelSet((truth,)), LabelSet((found,)))
    report = box_scores_report(
        scores, inputs=[{"path": _NASTY, "bytes": 1234}], files=3, settings={"iou": 0.5}
    )
    write_report(folder / "report.html", report)
    return (folder / "report.html").read_text()


def test_the_report_tells_the_figures(tmp_path: Path) -> None:
    text = re.sub(r"<[^>]+>", " ", _page(tmp_path))
    for words in ("AP50 0.500", "taken for", "30-50 m", "deer", "And 2 more", "1,234", "doubtful"):
        assert words in text, words


def test_names_of_strangers_stay_text(tmp_path: Path) -> None:
    page = _page(tmp_path)
    pictures = re.findall(r"data:image/svg\+xml;base64,([\w+/=]+)", page)
    assert pictures
    for text in (page, *(base64.b64decode(data).decode() for data in pictures)):
        assert "<script" not in text.lower()


def test_curves_run_from_corner_to_corner_and_leave_gaps() -> None:
    svg = share_curves("t", "x", "y", {"car": ([0, 0.5, 1], [1, float("nan"), 0])})
    first, last = re.findall(r'd="M([\d.]+) ([\d.]+)L\1 \2"', svg)  # two lone points, no line
    assert float(first[0]) < float(last[0])
    assert float(first[1]) < float(last[1])  # 1 is above 0, which is further down in an SVG
    with pytest.raises(GeometryError, match="as many values"):
        share_curves("t", "x", "y", {"car": ([0, 1], [1])})
