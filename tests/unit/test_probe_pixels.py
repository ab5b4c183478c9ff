"""A network that finds nothing is shown the same images as other numbers, with care."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from onnx_graphs import yolo_graph

from percept.core.errors import InputError
from percept.detection import YoloConfig, YoloDetector
from percept.detection.images.pixels import PIXEL_FORMATS, name_of_pixels
from percept.detection.networks.layout import Layout
from percept.detection.probe import ProbeReport, probe_pixels

_STREET = np.full((40, 60, 3), 7, np.uint8)
_Score = Callable[[str, bool], float]


@dataclass
class _Spec:
    dtype: str = "float32"


@dataclass
class _Network:
    image: _Spec = field(default_factory=_Spec)


@dataclass
class _Detector:
    """A detector whose score depends on its pixels, and on whether the image is the street."""

    score_of: _Score
    layout: Layout
    config: YoloConfig
    network: _Network = field(default_factory=_Network)

    def best_score(self, pixels: NDArray[Any]) -> float:
        return self.score_of(name_of_pixels(self.layout.pixels), bool((pixels == 7).all()))

    def with_layout(self, layout: Layout) -> _Detector:
        return _Detector(self.score_of, layout, self.config, self.network)


def _probe(score_of: _Score, pixels: str = "rgb1", *, dtype: str = "float32",
           asked: bool = False, images: int = 2) -> ProbeReport:  # fmt: skip
    layout = Layout("v5", ("car",), (64, 64), pixels=PIXEL_FORMATS[pixels], why=("as found",))
    config = YoloConfig.model_validate({"pixels": pixels if asked else None})
    detector = _Detector(score_of, layout, config, _Network(_Spec(dtype)))
    return probe_pixels(cast("YoloDetector", detector), [_STREET] * images)


def _pixels(report: ProbeReport) -> str:
    return name_of_pixels(report.detector.layout.pixels)


def test_a_network_that_finds_something_is_left_alone() -> None:
    report = _probe(lambda name, _: 0.9 if name.endswith("255") else 0.3)
    assert (report.note, report.found_nothing) == (None, False)
    assert report.best_scores == {"rgb1": 0.3}
    assert report.detector.layout.why == ("as found",)


def test_the_other_range_is_taken_and_said() -> None:
    report = _probe(lambda name, street: 0.8 * (street and name.endswith("255")))
    assert _pixels(report) == "bgr255"
    assert not report.found_nothing
    note = "pixels: bgr255 after all, since nothing is found in 2 images with the pixels as rgb1"
    assert report.note is not None
    assert report.note.startswith(note)
    assert report.detector.layout.why == ("as found", report.note)
    assert _pixels(_probe(lambda n, street: 0.8 * (street and n == "rgb1"), "bgr255")) == "rgb1"


@pytest.mark.parametrize(
    ("score_of", "advice"),
    [
        (lambda name, _: 0.49 * (name == "bgr255"), "nor as bgr255, rgb255, bgr1"),
        (lambda name, _: 0.8 * (name == "bgr255"), "but boxes as bgr255: set the"),
        (lambda name, street: 0.8 * (street and name == "bgr1"), "but boxes as bgr1: set the"),
    ],
    ids=["nothing is clear", "it fires on noise too", "only the order of channels differs"],
)
def test_weak_evidence_changes_nothing(score_of: _Score, advice: str) -> None:
    report = _probe(score_of)
    assert _pixels(report) == "rgb1"
    assert report.found_nothing
    assert report.note is not None
    assert advice in report.note


def test_what_the_user_set_is_not_changed() -> None:
    report = _probe(lambda name, street: 0.8 * (street and name == "bgr255"), asked=True)
    assert _pixels(report) == "rgb1"
    assert report.note is not None
    assert "but boxes as bgr255" in report.note


def test_bytes_have_no_other_range() -> None:
    report = _probe(lambda name, _: 0.8 * name.endswith("1"), "rgb255", dtype="uint8")
    assert set(report.best_scores) == {"rgb255", "bgr255"}
    assert report.found_nothing


def test_a_network_that_breaks_on_other_numbers_is_not_blamed() -> None:
    def broken() -> float:
        raise InputError("the network put out numbers that are infinite")

    report = _probe(lambda name, _: broken() if name.endswith("255") else 0.0)
    assert report.best_scores["bgr255"] == 0
    assert report.found_nothing


def test_no_image_says_nothing() -> None:
    report = _probe(lambda _name, _street: 0.0, images=0)
    assert (report.note, report.found_nothing) == (None, False)


def test_a_real_session_with_numbers_of_the_other_range(tmp_path: Path) -> None:
    detector = YoloDetector(yolo_graph(tmp_path / "network.onnx", "v8", fires="0..255"))
    image = np.random.default_rng(0).integers(0, 256, (100, 100, 3), dtype=np.uint8)
    report = probe_pixels(detector, [image])
    # It fires on anything bright, so that nobody can tell whether it sees objects.
    assert report.found_nothing
    assert report.best_scores["rgb1"] == 0
    assert report.best_scores["bgr255"] > 0.9
    assert not detector.dropped
