"""From images to boxes in their pixels, with networks that find what is known."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from onnx_graphs import KnownBoxes, known_boxes, yolo_graph

from percept.core.errors import ConfigError, GeometryError, InputError, UsageError
from percept.core.settings import parse_settings
from percept.detection import YoloConfig, YoloDetector
from percept.detection.images.rectangles import stride_of_rectangles

_Boxes = NDArray[np.float64]


def _image(width: int, height: int, seed: int = 0) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def _detector(folder: Path, layout: str = "v8", **graph: Any) -> YoloDetector:
    return YoloDetector(yolo_graph(folder / "network.onnx", layout, **graph))


def _configured(folder: Path, **config: Any) -> YoloDetector:
    path = yolo_graph(folder / "network.onnx", "v8", class_count=80)
    return YoloDetector(path, parse_settings(YoloConfig, config, "test"))


def _of_any_size(path: Path) -> Path:
    model = onnx.load(path)
    for axis, name in ((2, "height"), (3, "width")):
        model.graph.input[0].type.tensor_type.shape.dim[axis].dim_param = name
    onnx.save(model, path)
    return path


def _centre(boxes: _Boxes, width: int, height: int, side: int = 640) -> _Boxes:
    """Ultralytics' `scale_boxes`, in its own words."""
    ratio = min(side / width, side / height)
    across, down = round(width * ratio), round(height * ratio)
    left, top = round((side - across) / 2 - 0.1), round((side - down) / 2 - 0.1)
    return (boxes - [left, top, left, top]) * ([width / across, height / down] * 2)


def _corner(boxes: _Boxes, width: int, height: int, side: int = 640) -> _Boxes:
    return boxes / min(side / width, side / height)


def _stretch(boxes: _Boxes, width: int, height: int, side: int = 640) -> _Boxes:
    return boxes * ([width / side, height / side] * 2)


@pytest.mark.parametrize("size", [(641, 479), (1919, 1079), (333, 777), (37, 29), (640, 640)])
@pytest.mark.parametrize(
    ("layout", "back"), [("v8", _centre), ("yolox", _corner), ("v4", _stretch)]
)
def test_boxes_of_odd_images(tmp_path: Path, layout: str, back: Any, size: tuple[int, int]) -> None:
    known = known_boxes()
    (found,) = _detector(tmp_path, layout).detect([_image(*size)])
    expected = back(known.boxes, *size)
    inside = (expected[:, 2:] > 0).all(1) & (expected[:, :2] < size).all(1)
    assert inside.sum() >= 2
    np.testing.assert_allclose(found.boxes_px, expected[inside], atol=0.01)
    np.testing.assert_allclose(found.confidences, known.scores[inside], atol=1e-3)
    assert len(found.labels) == inside.sum()


def test_boxes_in_the_padding_are_dropped_and_counted(tmp_path: Path) -> None:
    boxes = np.array([[100.0, 20, 300, 130], [100, 300, 300, 400]])
    known = KnownBoxes(boxes, np.array([0, 1]), np.array([0.9, 0.8]))
    detector = _detector(tmp_path, known=known)
    found, _ = detector.detect_one(_image(1280, 720))  # padded above row 140
    assert len(found) == 1
    np.testing.assert_allclose(found.boxes_px, [[200, 320, 600, 520]], atol=1e-3)
    assert detector.dropped == {"boxes outside the image": 1}


def test_boxes_over_the_border_are_not_clipped(tmp_path: Path) -> None:
    known = KnownBoxes(np.array([[-4.0, 200, 90, 300]]), np.array([0]), np.array([0.9]))
    found, _ = _detector(tmp_path, known=known).detect_one(_image(640, 640))
    np.testing.assert_allclose(found.boxes_px, [[-4, 200, 90, 300]], atol=1e-3)


def test_duplicates_go_unless_the_network_has_seen_to_it(tmp_path: Path) -> None:
    boxes = np.array([[100.0, 100, 200, 200], [110, 100, 210, 200], [60, 100, 160, 200]])
    known = KnownBoxes(boxes, np.array([3, 3, 4]), np.array([0.9, 0.8, 0.7]))
    image = _image(640, 640)
    found, _ = _detector(tmp_path, known=known).detect_one(image)
    assert found.confidences.round(3).tolist() == [0.9, 0.7]  # another class stays
    found, _ = _detector(tmp_path, "end2end", known=known).detect_one(image)
    assert found.confidences.round(3).tolist() == [0.9, 0.8, 0.7]


def test_thresholds_by_class(tmp_path: Path) -> None:
    image = _image(640, 640)
    labels = _configured(tmp_path).detect([image])[0].labels  # 0.91, 0.78, 0.63, 0.55
    assert len(set(labels)) == 4
    stricter = _configured(tmp_path, class_scores={labels[1]: 0.8})
    assert stricter.detect([image])[0].labels == (labels[0], *labels[2:])
    looser = _configured(tmp_path, score=0.7, class_scores={labels[3]: 0.5})
    assert looser.detect([image])[0].labels == (labels[0], labels[1], labels[3])
    assert not looser.dropped


def test_what_is_left_out_is_counted(tmp_path: Path) -> None:
    image = _image(640, 640)
    labels = _configured(tmp_path).detect([image])[0].labels
    few = _configured(tmp_path, classes=[labels[0], labels[2]])
    assert few.detect([image])[0].labels == (labels[0], labels[2])
    assert few.dropped == {"boxes of classes that were not asked for": 2}
    large = _configured(tmp_path, min_size_px=100)  # the third is 58 px wide
    assert large.detect([image])[0].labels == (labels[0], labels[1], labels[3])
    assert large.dropped == {"boxes below 100 px": 1}
    best = _configured(tmp_path, max_boxes=3)
    assert [len(found) for found in best.detect([image, image])] == [3, 3]
    assert best.dropped == {"boxes after the 3 most confident of an image": 2}


def test_a_class_that_is_not_there_is_refused(tmp_path: Path) -> None:
    for config in ({"classes": ["trafic light"]}, {"class_scores": {"trafic light": 0.4}}):
        with pytest.raises(UsageError, match=r"no class 'trafic light'\. The nearest is 'traffic"):
            _configured(tmp_path, **config)
    with pytest.raises(ConfigError, match="score"):
        _configured(tmp_path, score=1.5)


def test_a_fixed_batch_is_filled(tmp_path: Path) -> None:
    image = _image(641, 479)
    one = _detector(tmp_path).detect([image] * 3)
    detector = _detector(tmp_path, batch=4)
    assert detector.layout.why[-1].startswith("batch: all 4 places get one image")
    four = detector.detect([image] * 3)
    assert len(four) == 3
    for a, b in zip(one, four, strict=True):
        np.testing.assert_array_equal(a.boxes_px, b.boxes_px)


def test_dynamic_networks_see_rectangles(tmp_path: Path) -> None:
    boxes = np.array([[64.0, 32, 160, 96], [500, 200, 630, 370]])
    known = KnownBoxes(boxes, np.array([2, 5]), np.array([0.9, 0.8]))
    path = yolo_graph(tmp_path / "network.onnx", "v8", known, dynamic=True)
    image = _image(1280, 720)
    detector = YoloDetector(path)
    tensor, _ = detector.prepare(image)
    assert tensor.shape == (1, 3, 384, 640)
    # 12 rows of padding above, and half the size.
    expected = (boxes - [0, 12, 0, 12]) * 2
    np.testing.assert_allclose(detector.detect([image])[0].boxes_px, expected, atol=1e-3)
    assert detector.prepare(_image(100, 4000))[0].shape == (1, 3, 640, 32)
    assert "in steps of 32 px" in detector.layout.why[-1]
    stretched = replace(detector.layout, fit="stretch")
    assert stride_of_rectangles(detector.network, stretched, None)[0] is None
    fixed = YoloDetector(path, YoloConfig(input_size=(320, 320)))
    assert fixed.prepare(image)[0].shape == (1, 3, 320, 320)
    assert "an input of 320 x 320" in fixed.layout.why[-1]


@pytest.mark.parametrize(
    ("layout", "strides", "height"),
    [("v8", (8, 16, 32), 224), ("v8-last", (8, 16, 32, 64), 256), ("v5", (8, 16), 208)],
)
def test_the_coarsest_stride_is_the_step(
    tmp_path: Path, layout: str, strides: tuple[int, ...], height: int
) -> None:
    detector = _detector(tmp_path, layout, dynamic=True, strides=strides)
    assert detector.prepare(_image(1242, 375))[0].shape == (1, 3, height, 640)


@pytest.mark.parametrize(("stride", "height"), [("32", 224), ("64", 256), ("7", 256), ("", 256)])
def test_without_cells_the_file_says_the_stride(tmp_path: Path, stride: str, height: int) -> None:
    path = yolo_graph(tmp_path / "network.onnx", "end2end", metadata={"stride": stride})
    detector = YoloDetector(_of_any_size(path))
    assert detector.prepare(_image(1242, 375))[0].shape == (1, 3, height, 640)


def test_a_network_that_is_dynamic_by_name_only_gets_its_whole_input(tmp_path: Path) -> None:
    path = yolo_graph(tmp_path / "network.onnx", "v8", dynamic=True)
    model = onnx.load(path)
    model.graph.initializer.append(
        numpy_helper.from_array(np.zeros((1, 3, 640, 640), np.float32), "baked")
    )
    for node in model.graph.node:
        node.input[:] = ["checked" if name == "images" else name for name in node.input]
    model.graph.node.insert(0, helper.make_node("Add", ["images", "baked"], ["checked"]))
    onnx.save(model, path)
    detector = YoloDetector(path)
    assert detector.prepare(_image(1280, 720))[0].shape == (1, 3, 640, 640)
    assert "does not follow smaller ones" in detector.layout.why[-1]
    assert len(detector.detect([_image(640, 640)])[0]) == 4


def test_a_network_that_resizes_its_input_itself_gets_its_whole_input(tmp_path: Path) -> None:
    # 8400 boxes, whatever the size of the input.
    detector = YoloDetector(_of_any_size(yolo_graph(tmp_path / "network.onnx", "v8")))
    assert detector.prepare(_image(1280, 720))[0].shape == (1, 3, 640, 640)
    assert "does not follow smaller ones" in detector.layout.why[-1]


def test_tiles_are_looked_at_besides_the_whole(tmp_path: Path) -> None:
    known = KnownBoxes(np.array([[200.0, 200, 300, 300]]), np.array([0]), np.array([0.9]))
    path = yolo_graph(tmp_path / "network.onnx", "v8", known)
    detector = YoloDetector(path, YoloConfig(tiles=(2, 1), tile_overlap=0))
    found, timings_ms = detector.detect_one(_image(1280, 640))
    # The whole image at half the size, with 160 rows above; each tile as it is.
    expected = [[400, 80, 600, 280], [200, 200, 300, 300], [840, 200, 940, 300]]
    np.testing.assert_allclose(found.boxes_px, expected, atol=1e-3)
    assert set(timings_ms) == {"prepare", "network", "boxes"}


def test_an_object_in_two_tiles_is_one(tmp_path: Path) -> None:
    known = KnownBoxes(np.array([[100.0, 120, 500, 520]]), np.array([0]), np.array([0.9]))
    path = yolo_graph(tmp_path / "network.onnx", "end2end", known)
    detector = YoloDetector(path, YoloConfig(tiles=(1, 2), tile_overlap=0.8))
    # Tiles of 534 rows, 53 rows of padding above them: 53 rows up and down from the whole.
    assert len(detector.detect([_image(640, 640)])[0]) == 1
    apart = YoloDetector(path, YoloConfig(tiles=(1, 2), tile_overlap=0.8, iou=0.9))
    assert len(apart.detect([_image(640, 640)])[0]) == 3


def test_threads_and_batches_agree(tmp_path: Path) -> None:
    detector = _detector(tmp_path, "yolox")
    images = [_image(300 + 7 * n, 200 + 11 * n, seed=n) for n in range(24)]
    together = detector.detect(images)
    with ThreadPoolExecutor(4) as pool:
        for found, (alone, timings_ms) in zip(
            together, pool.map(detector.detect_one, images), strict=True
        ):
            np.testing.assert_array_equal(found.boxes_px, alone.boxes_px)
            np.testing.assert_array_equal(found.confidences, alone.confidences)
            assert found.labels == alone.labels
            assert all(value >= 0 for value in timings_ms.values())


def test_hostile_images(tmp_path: Path) -> None:
    detector = _detector(tmp_path)
    grey = _image(300, 200)[..., 0]
    found = detector.detect([grey, np.repeat(grey[..., None], 3, 2), grey[..., None]])
    np.testing.assert_array_equal(found[0].boxes_px, found[1].boxes_px)
    np.testing.assert_array_equal(found[0].boxes_px, found[2].boxes_px)
    for shape in ((1, 1, 3), (1, 4000, 3), (4000, 1, 3)):
        (boxes,) = detector.detect([np.zeros(shape, np.uint8)])
        assert np.isfinite(boxes.boxes_px).all()
    for bad, reason in (
        (np.zeros((0, 4, 3), np.uint8), "4 x 0 pixels is empty"),
        (np.zeros((4, 4, 4), np.uint8), r"not \(4, 4, 4\)"),
        (np.zeros((4, 4), np.uint16), "which value is white"),
        (np.zeros((4, 4), np.float32), "which value is white"),
    ):
        with pytest.raises(GeometryError, match=f"image 1 of 2: .*{reason}"):
            detector.detect([grey, bad])
    unread: Any = None
    with pytest.raises(GeometryError, match=r"an array, not NoneType.*cv2\.imread"):
        detector.detect([unread])


def test_one_image_is_no_list_of_images(tmp_path: Path) -> None:
    detector = _detector(tmp_path)
    with pytest.raises(GeometryError, match=r"\(200, 300, 3\).*Give a list"):
        detector.detect(_image(300, 200))
    assert len(detector.detect(np.stack([_image(300, 200)] * 2))) == 2
    assert detector.detect([]) == []


def test_a_broken_network_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    detector = _detector(tmp_path)

    def broken(*_: object) -> None:
        raise InputError("numbers that are infinite", remedy="Export it again")

    monkeypatch.setattr("percept.detection.yolo.decode", broken)
    with pytest.raises(InputError, match=r"network\.onnx: numbers .* infinite\. Export it again"):
        detector.detect_one(_image(64, 64))


def test_another_layout_is_counted_for_itself(tmp_path: Path) -> None:
    detector = _configured(tmp_path, max_boxes=3)
    other = detector.with_layout(replace(detector.layout, pad=0))
    other.detect([_image(640, 640)])
    assert sum(other.dropped.values()) == 1
    assert not detector.dropped


def test_a_white_level_makes_deep_pixels_bytes(tmp_path: Path) -> None:
    detector = _configured(tmp_path, white_level=1023)
    assert len(detector.detect([np.full((640, 640), 512, np.uint16)])[0]) == 4


def test_all_that_was_resolved_is_told(tmp_path: Path) -> None:
    told = json.loads(json.dumps(_configured(tmp_path, tiles=[2, 1]).describe()))
    assert told["layout"] == "v8"
    assert told["pixels"] == "rgb1"
    assert told["input_size"] == [640, 640]
    assert told["class_count"] == len(told["class_names"]) == 80
    assert told["device"] == "cpu"
    assert told["config"]["tiles"] == [2, 1]
    assert told["why"]
    unnamed = _detector(tmp_path, "end2end").describe()
    assert unnamed["class_count"] is None
    assert unnamed["class_names"] is None
    assert _detector(tmp_path, "end2end", names=True).describe()["class_count"] == 80
