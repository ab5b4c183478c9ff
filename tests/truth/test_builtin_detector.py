"""The detector that ships, on streets that it was not trained on."""

from __future__ import annotations

import numpy as np
import pytest

from percept.core.labels import LabelledImage, LabelSet
from percept.datasets.synthetic.views import random_view
from percept.detection import YoloConfig, YoloDetector
from percept.detection.models import builtin_model
from percept.evaluation.boxes_2d import BoxScoreConfig, BoxScores, score_boxes

# Chosen without looking: the first views of the seeds that no training has seen.
VIEWS = 24
CLASSES = {
    "car", "truck", "cyclist", "pedestrian", "deer", "barrel", "barricade", "cone", "sign",
    "light_red", "light_yellow", "light_green", "light_off",
}  # fmt: skip


@pytest.fixture(scope="module")
def detector() -> YoloDetector:
    return YoloDetector(builtin_model(), YoloConfig(score=0.01), device="cpu")


@pytest.fixture(scope="module")
def scores(detector: YoloDetector) -> BoxScores:
    truth, found = [], []
    for seed in range(VIEWS):
        view = random_view(seed, seed, supersampling=2)
        (seen,) = detector.detect([view.pixels])
        boxes = view.boxes
        truth.append(
            LabelledImage.of(str(seed), boxes.boxes_px, boxes.labels, visible=boxes.visible)
        )
        found.append(LabelledImage.of(str(seed), seen.boxes_px, seen.labels, seen.confidences))
    names = dict(enumerate(sorted(CLASSES)))
    return score_boxes(
        LabelSet(tuple(truth), categories=names),
        LabelSet(tuple(found), categories=names),
        BoxScoreConfig(score=0.5, min_height_px=10.0, min_visible=0.3),
    )


def test_it_is_small_and_nothing_special() -> None:
    assert builtin_model().stat().st_size < 4_000_000
    layout = YoloDetector(builtin_model(), device="cpu").layout
    assert layout.name == "v8"
    assert set(layout.class_names) == CLASSES


def test_it_finds_the_objects_of_streets_that_it_has_not_seen(scores: BoxScores) -> None:
    assert scores.images == VIEWS
    assert scores.counts.objects > 200
    assert scores.average.ap50 >= 0.8


def test_it_is_right_where_it_is_confident(scores: BoxScores) -> None:
    assert scores.score == 0.5
    assert scores.counts.precision > 0.8
    assert scores.counts.recall > 0.6


def test_it_finds_nothing_where_nothing_is(detector: YoloDetector) -> None:
    for level in (0, 60, 114, 180, 255):
        (seen,) = detector.detect([np.full((400, 640, 3), level, np.uint8)])
        assert (seen.confidences < 0.5).all()
