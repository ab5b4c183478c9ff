"""The classifier of light crops on real crops that it has not learnt from."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sklearn")

ALIKE = 0.93
RED, GREEN = 0, 2


@pytest.fixture
def training(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "scripts"))
    names = ("training.light_crops", "training.light_classifier")
    return importlib.import_module(names[0]), importlib.import_module(names[1])


@pytest.mark.slow
def test_a_fifth_that_was_held_out(shared_data: Path, training: tuple[Any, Any]) -> None:
    """Crops that look like one another are on one side only."""
    files, learning = training
    crops, classes = files.read_crops(
        shared_data / "traffic_light" / "mit_udacity_crops" / "training"
    )
    groups = files.similar_groups(crops, ALIKE)
    learn, test = learning.splits(classes, groups, seed=1)[0]
    assert not set(groups[learn]) & set(groups[test])
    classifier = learning.fit([crops[row] for row in learn], classes[learn], seed=1)
    held_out = [crops[row] for row in test]
    views = learning.test_views(held_out, classes[test], seed=1)
    for name in ("as they are", "8 px high", "12 px high"):
        features, truth = views[name]
        chances = classifier.chances(features)
        assert (chances.argmax(axis=1) == truth).mean() >= 0.98, name
        assert chances[truth == RED, GREEN].max() < 0.9, name


def test_the_model_that_ships_knows_its_crops(shared_data: Path, training: tuple[Any, Any]) -> None:
    """It learnt from these, so this shows only that the file is the one that was trained."""
    from percept.lights.colours import classify_light_crops

    files, _ = training
    crops, classes = files.read_crops(
        shared_data / "traffic_light" / "mit_udacity_crops" / "training"
    )
    answers = classify_light_crops(crops)
    states = np.array([state for state, _ in answers])
    truth = np.array(files.STATES)[classes]
    assert (states == truth).mean() >= 0.985
    assert not (states[truth == "red"] == "green").any()
    chances = np.array([chance for _, chance in answers])
    assert abs(chances.mean() - (states == truth).mean()) < 0.02
