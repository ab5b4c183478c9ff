"""What a report says of tracks, lights and health: figures that can be counted by hand."""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_tracks import START_NS, STEP_NS, make_lights, make_tracks, make_trajectory

from percept.core.errors import GeometryError
from percept.core.results import Verdict
from percept.export.charts import Stretch, state_lanes
from percept.export.health import run_health
from percept.export.light_report import LightSummary, light_sections
from percept.export.report import Picture, ReportContent, Section, Table, write_report
from percept.export.track_pictures import trails_from_above
from percept.export.tracking_report import TrackingReport, tracking_sections
from percept.export.tracking_summary import TrackingSummary

_SVG = "{http://www.w3.org/2000/svg}"


def _tracking(steps: int = 60) -> TrackingSummary:
    """Return tracks of which the second turns from a pedestrian into a deer."""
    summary = TrackingSummary()
    for step in range(steps):
        tracks = make_tracks(step, count=3 if step < 20 else 2)
        if step >= 40:
            tracks = replace(tracks, labels=("car", "deer"), states=("full", "full"))
        elif step >= 20:
            tracks = replace(tracks, states=("full", "full"))
        summary.add(tracks)
    return summary


def _lights(steps: int = 100) -> LightSummary:
    summary = LightSummary()
    for step in range(steps):
        summary.add(make_lights(step))
    return summary


def _blocks(sections: tuple[Section, ...]) -> dict[str, list[Table]]:
    return {s.title: [b for b in s.blocks if isinstance(b, Table)] for s in sections}


def _svg(picture: Picture) -> ET.Element:
    return ET.XML(base64.b64decode(picture.data_uri.partition(",")[2]))


class TestTracks:
    def test_counts_lives_and_speeds(self) -> None:
        part = TrackingReport(
            summary=_tracking(), dropped={"later than the window": 4}, counts={"joined": 2}
        )
        classes, counts = _blocks(tracking_sections(part))["Tracks"]
        assert classes.rows == (
            ("car", "1", "5.9", "5.9", "2.0", "2.0", "50%", "0"),
            ("pedestrian", "1", "5.9", "5.9", "3.0", "3.0", "50%", "1"),
        )
        assert counts.rows == (
            ("moments", "60"),
            ("full tracks", "2"),
            ("tracks on trial that never became full", "1"),
            ("joined", "2"),
            ("left out: later than the window", "4"),
        )

    def test_the_picture_has_path_and_trails(self) -> None:
        sections = tracking_sections(TrackingReport(summary=_tracking(), poses=make_trajectory()))
        picture = sections[0].blocks[0]
        assert isinstance(picture, Picture)
        png = base64.b64decode(picture.data_uri.partition(",")[2])
        image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert max(image.shape) <= 960
        for rgb in ((86, 180, 233), (213, 94, 0), (228, 232, 236)):  # car, pedestrian, vehicle
            assert (image == rgb[::-1]).all(axis=2).sum() > 100
        assert "frame map" in picture.caption

    def test_nothing_tracked(self) -> None:
        (section,) = tracking_sections(TrackingReport(summary=TrackingSummary()))
        assert section.title == "Tracks"
        summary = TrackingSummary()
        summary.add(make_tracks(0, count=0))
        assert len(tracking_sections(TrackingReport(summary=summary))) == 1


class TestTrailsFromAbove:
    def test_north_is_up_and_what_stands_is_a_dot(self) -> None:
        east = np.column_stack([np.linspace(0, 40, 9), np.full(9, 20.0)])
        image = trails_from_above([("car", east), ("cone", np.zeros((5, 2)))], np.zeros((1, 2)))
        header = image.shape[0] - 480  # 20 m of 40 m, which are 820 pixels, and the margins
        car = np.argwhere((image[header + 10 :] == (233, 180, 86)).all(axis=2))
        cone = np.argwhere((image[header + 10 :] == (119, 102, 204)).all(axis=2))
        assert np.ptp(car[:, 1]) > 700
        assert np.ptp(cone[:, 1]) < 12
        assert car[:, 0].mean() < cone[:, 0].mean()

    @pytest.mark.parametrize("place", [np.zeros((0, 2)), np.zeros((3, 3)), np.full((2, 2), np.nan)])
    def test_what_is_no_trail_is_refused(self, place: np.ndarray) -> None:
        with pytest.raises(GeometryError, match="trail"):
            trails_from_above([("car", place)])


class TestLights:
    def test_says_what_each_light_showed(self) -> None:
        (table,) = _blocks(light_sections(_lights()))["Traffic lights"]
        red, flashing, lost = table.rows
        assert red == ("501", "9.9", "100%", "2", "red 80%, green 20%", "front, left")
        assert flashing[4].startswith("yellow flashing 87%")
        assert flashing[2] == "100%"
        assert lost[2] == "70%"
        assert "not seen 30%" in lost[4]
        assert lost[3] == "6"  # dark and back three times: not seen is no change

    def test_lanes_of_lights_and_health_share_their_time(self) -> None:
        stamps = START_NS + STEP_NS * np.array([*range(40), *range(60, 100)])
        health = run_health({"lidar <top>": stamps})
        sections = light_sections(_lights(), health)
        assert [section.title for section in sections] == [
            "Lights and health over time", "Traffic lights", "Health",
        ]  # fmt: skip
        chart = sections[0].blocks[0]
        assert isinstance(chart, Picture)
        root = _svg(chart)
        names = [text.text for text in root.iter(f"{_SVG}text")]
        assert {"light 501", "light 777", "lidar <top>", "late", "flashing", "dark"} <= {*names}
        said = {title.text for title in root.iter(f"{_SVG}title")}
        assert "late, 4.2 to 6.0 s" in said
        assert "green, 4.0 to 6.0 s" in said
        (row,) = _blocks(sections)["Health"][0].rows
        assert row[:4] == ("lidar <top>", "80", "7.98", "10.00")
        assert row[5:] == ("18.2%", "1", "1.80")

    def test_a_light_that_leaves_has_an_end(self) -> None:
        summary = LightSummary()
        gone = replace(
            make_lights(0), ids=np.zeros(0, np.int64), states=(), flashing=np.zeros(0, bool),
            probabilities=np.zeros(0), cameras=(),
        )  # fmt: skip
        for step in range(10):
            summary.add(make_lights(step))
        for step in range(10, 30):
            summary.add(replace(gone, stamp_ns=START_NS + step * STEP_NS))
        assert [end for _, end, _ in summary.stretches(501)] == [START_NS + 10 * STEP_NS]

    def test_nothing_to_say(self) -> None:
        assert light_sections(None) == ()
        (section,) = light_sections(LightSummary())
        assert section.title == "Traffic lights"

    def test_very_many_lights(self) -> None:
        summary = LightSummary()
        count = 150
        for step in (0, 10):
            summary.add(
                replace(
                    make_lights(0), stamp_ns=START_NS + step * STEP_NS, ids=np.arange(count),
                    states=("red",) * count, flashing=np.zeros(count, bool),
                    probabilities=np.ones(count), cameras=((),) * count,
                )
            )  # fmt: skip
        sections = light_sections(summary)
        assert len(_blocks(sections)["Traffic lights"][0].rows) == 100
        assert any("50 more lights" in str(block) for block in sections[1].blocks)
        chart = sections[0].blocks[0]
        assert isinstance(chart, Picture)
        assert chart.caption.startswith("126 more lights")


class TestLanes:
    def test_flicker_does_not_make_it_large(self) -> None:
        lane = [Stretch(k / 100, (k + 1) / 100, ("red", "dark")[k % 2]) for k in range(200_000)]
        colours = {"red": (222, 56, 49), "dark": (0, 0, 0)}
        svg = state_lanes("a & b", {"<x>": lane}, colours, end_s=2000)
        assert len(svg) < 500_000
        assert "a &amp; b" in svg
        assert "&lt;x&gt;" in svg

    def test_flashing_is_hatched(self) -> None:
        lane = [Stretch(0, 1, "red flashing"), Stretch(1, 2, "red")]
        root = ET.XML(state_lanes("t", {"a": lane}, {"red": (1, 2, 3)}, end_s=2))
        bars = [bar for bar in root.iter(f"{_SVG}rect") if bar.get("height") == "14.0"]
        assert [bar.get("fill") for bar in bars] == ["#010203", "url(#hatch)", "#010203"]


def test_all_of_it_is_escaped(tmp_path: Path) -> None:
    summary = TrackingSummary()
    tracks = make_tracks(0, count=1)
    summary.add(replace(tracks, labels=("<script>alert(1)</script>",), frame_id="<b>"))
    part = TrackingReport(summary=summary, dropped={"<i>late": 1}, counts={"<u>": 1})
    sections = (*tracking_sections(part), *light_sections(None, run_health({"<s>": [1, 2]})))
    write_report(tmp_path / "r.html", ReportContent("t", Verdict.GOOD, (), (), sections))
    page = (tmp_path / "r.html").read_text()
    assert "<script>" not in page
    for tag in ("<i>late", "<u>", "<s>", "<b>"):
        assert tag not in page
