"""The network for road lines: fed and read right, and refused where it is none."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from percept.core.errors import GeometryError, InputError
from percept.detection.road_lines import RoadLineNetwork

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "truth"))

from onnx_graphs import write_graph

_SIZE = (64, 96)  # height and width


def _network(tmp_path: Path, scores: np.ndarray) -> RoadLineNetwork:
    path = write_graph(
        tmp_path / "lines.onnx", {"mask": scores.astype(np.float32)}, image=(1, 3, *_SIZE)
    )
    return RoadLineNetwork(path)


def test_probabilities_are_brought_to_the_image(tmp_path: Path) -> None:
    scores = np.zeros((1, 1, *_SIZE))
    scores[..., 48:] = 1.0
    mask = _network(tmp_path, scores).mask(np.zeros((128, 192, 3), np.uint8))
    assert mask.shape == (128, 192)
    assert mask.dtype == np.float32
    assert mask[:, :90].max() == 0
    assert mask[:, 102:].min() == 1


def test_logits_of_one_channel_and_of_classes_become_probabilities(tmp_path: Path) -> None:
    one = _network(tmp_path, np.full((1, 1, *_SIZE), 2.0)).mask(np.zeros((*_SIZE, 3), np.uint8))
    assert one == pytest.approx(1 / (1 + np.exp(-2.0)), abs=1e-5)
    classes = np.zeros((1, 3, *_SIZE))
    classes[:, 0] = np.log(2.0) + 5
    classes[:, 1:] = 5
    three = _network(tmp_path, classes).mask(np.zeros((*_SIZE, 3), np.uint8))
    assert three == pytest.approx(0.5, abs=1e-5)


def test_other_networks_and_images_are_refused(tmp_path: Path) -> None:
    path = write_graph(
        tmp_path / "boxes.onnx", {"boxes": np.zeros((1, 84, 100))}, image=(1, 3, *_SIZE)
    )
    with pytest.raises(InputError, match="no network for road lines"):
        RoadLineNetwork(path)
    network = _network(tmp_path, np.zeros((1, 1, *_SIZE)))
    with pytest.raises(GeometryError, match="uint8"):
        network.mask(np.zeros((5, 5), np.uint8))
    (tmp_path / "cut.onnx").write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="not a whole ONNX network"):
        RoadLineNetwork(tmp_path / "cut.onnx")
