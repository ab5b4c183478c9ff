"""The official YOLOX-nano on real images: the boxes that onnxruntime and YOLOX's own way gave."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from numpy.typing import NDArray

from percept.core.results import Detections2D
from percept.detection import YoloConfig, YoloDetector
from percept.detection.probe import probe_pixels

_Boxes = NDArray[np.float64]


@pytest.fixture(scope="module")
def network(shared_data: Path) -> Path:
    return shared_data / "yolo/yolox_nano/yolox_nano.onnx"


@pytest.fixture(scope="module")
def expected(shared_data: Path) -> dict[str, list[dict[str, Any]]]:
    text = (shared_data / "yolo/yolox_nano/reference_detections.json").read_text()
    found: dict[str, list[dict[str, Any]]] = json.loads(text)["detections"]
    return found


def _read(path: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(path))
    assert image is not None
    return np.asarray(image, np.uint8)


def _ious(a: _Boxes, b: _Boxes) -> _Boxes:
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = (high - low).clip(0).prod(2)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(1) for boxes in (a, b)]
    ious: _Boxes = shared / (areas[0][:, None] + areas[1][None] - shared)
    return ious


def _cars(found: Detections2D) -> _Boxes:
    return found.boxes_px[[label == "car" for label in found.labels]]


def test_detections_equal_the_reference(
    network: Path, expected: dict[str, list[dict[str, Any]]], shared_data: Path
) -> None:
    detector = YoloDetector(network, YoloConfig(score=0.3))
    assert (detector.layout.name, detector.layout.fit) == ("yolox", "corner")
    assert sum(map(len, expected.values())) == 13
    for name, boxes in expected.items():
        found, _ = detector.detect_one(_read(shared_data / name))
        assert found.labels == tuple(box["class"] for box in boxes)
        if boxes:
            difference_px = found.boxes_px - [box["xyxy"] for box in boxes]
            assert np.abs(difference_px).max() < 0.1
            difference = found.confidences - [box["score"] for box in boxes]
            assert np.abs(difference).max() < 1e-3
    assert not detector.dropped


def _labelled_cars(shared_data: Path) -> _Boxes:
    labels = json.loads((shared_data / "scenes/kitti_000008/000008.json").read_text())
    objects = labels["data_list"][0]["instances"]
    return np.array([o["bbox"] for o in objects if o["bbox_label"] == 2], float)


def test_all_labelled_cars_are_found(network: Path, shared_data: Path) -> None:
    image = _read(shared_data / "scenes/kitti_000008/000008.png")
    found, _ = YoloDetector(network).detect_one(image)
    labelled = _labelled_cars(shared_data)
    assert len(labelled) == 6
    assert (_ious(labelled, _cars(found)).max(1) > 0.5).all()


def test_a_dynamic_copy_finds_them_in_a_rectangle(
    network: Path, shared_data: Path, tmp_path: Path
) -> None:
    model = onnx.load(network)
    tensors = ((model.graph.input[0], {2: "h", 3: "w"}), (model.graph.output[0], {1: "rows"}))
    for tensor, names in tensors:
        for axis, name in names.items():
            tensor.type.tensor_type.shape.dim[axis].dim_param = name
    onnx.save(model, tmp_path / "dynamic.onnx")
    detector = YoloDetector(tmp_path / "dynamic.onnx")
    image = _read(shared_data / "scenes/kitti_000008/000008.png")
    assert detector.prepare(image)[0].shape == (1, 3, 224, 640)
    ious = _ious(_labelled_cars(shared_data), _cars(detector.detect([image])[0]))
    assert (ious.max(1) > 0.7).all()


def test_tiles_find_small_cars(network: Path, shared_data: Path) -> None:
    image = _read(shared_data / "scenes/kitti_000008/000008.png")
    at = (1100, 350)  # in a picture of three times its width and height
    wide = np.full((3 * 375, 3 * 1242, 3), 114, np.uint8)
    wide[at[1] : at[1] + 375, at[0] : at[0] + 1242] = image
    labelled = _labelled_cars(shared_data) + np.tile(at, 2)
    whole, _ = YoloDetector(network).detect_one(wide)
    assert (_ious(labelled, _cars(whole)).max(1) > 0.5).sum() <= 1
    tiled, _ = YoloDetector(network, YoloConfig(tiles=(3, 2))).detect_one(wide)
    ious = _ious(labelled, _cars(tiled))
    assert (ious.max(1) > 0.5).all()
    assert ((ious > 0.5).sum(1) == 1).all()  # one box for each, whatever tiles it lies in


def test_the_wrong_numbers_are_found_out(network: Path, shared_data: Path) -> None:
    images = [
        _read(shared_data / name)
        for name in ("scenes/kitti_000008/000008.png", "yolo/images/dog.jpg")
    ]
    wrong = YoloDetector(network, YoloConfig(pixels="rgb1"))
    asked = probe_pixels(wrong, images)
    assert asked.found_nothing
    assert asked.detector is wrong
    assert asked.note is not None
    assert "but boxes as bgr255" in asked.note
    # The same where the file was taken for one of 0..1 rather than said to be.
    right = YoloDetector(network)
    taken = probe_pixels(right.with_layout(wrong.layout), images)
    assert taken.detector.layout.pixels == right.layout.pixels
    assert len(taken.detector.detect(images)[0]) == len(right.detect(images)[0]) > 6


def test_a_network_on_pictures_of_nothing_is_reported(network: Path) -> None:
    report = probe_pixels(YoloDetector(network), [np.zeros((375, 1242, 3), np.uint8)])
    assert report.found_nothing
    assert set(report.best_scores) == {"bgr255", "rgb1", "rgb255", "bgr1"}
