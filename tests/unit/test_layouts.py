"""Every layout and collision is identified from its tensors, and gives the boxes it holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx_graphs import KnownBoxes, known_boxes, write_graph, yolo_graph

from percept.core.errors import InputError, UsageError
from percept.detection.networks.class_names import coco_names
from percept.detection.networks.decode import decode
from percept.detection.networks.identify import identify
from percept.detection.networks.layout import Layout, PixelFormat
from percept.detection.networks.network import Network, open_network

_SMALL = (320, 192)

# What a graph is made of, and what it must be read as.
_GRAPHS: dict[str, tuple[str, dict[str, Any], str]] = {
    "v8": ("v8", {}, "v8"),
    "v8 with names": ("v8", {"names": True}, "v8"),
    "v8 of 640 pixels": ("v8", {"size": (640, 640)}, "v8"),
    "v8 with 1 class: 5 rows": ("v8", {"class_count": 1}, "v8"),
    "v8 with 2 classes: 6 rows": ("v8", {"class_count": 2}, "v8"),
    "v8 with 81 classes: 85 rows": ("v8", {"class_count": 81}, "v8"),
    "v8 in bytes": ("v8", {"dtype": "uint8"}, "v8"),
    "v8 with the channels last": ("v8", {"channels_last": True}, "v8"),
    "v8 with dynamic shapes": ("v8", {"dynamic": True, "batch": "n", "size": (640, 640)}, "v8"),
    "v8 with a batch of 4": ("v8", {"batch": 4}, "v8"),
    "v8 with a batch of any size": ("v8", {"batch": "n"}, "v8"),
    "v8-P6": ("v8", {"strides": (8, 16, 32, 64)}, "v8"),
    "v8-P2": ("v8", {"strides": (4, 8, 16, 32)}, "v8"),
    "v3-tiny": ("v8", {"strides": (16, 32)}, "v8"),
    "v8 of an odd size": ("v8", {"size": (330, 190)}, "v8"),
    "v8 as wide as long": ("v8", {"size": (64, 64)}, "v8"),
    "v8-last as wide as long": ("v8-last", {"size": (64, 64)}, "v8-last"),
    "v8-last": ("v8-last", {}, "v8-last"),
    "v8-last with 2 names: 6 columns": ("v8-last", {"class_count": 2, "names": True}, "v8-last"),
    "v8-last with 81 names": ("v8-last", {"class_count": 81, "names": True}, "v8-last"),
    "v8-last with dynamic shapes": ("v8-last", {"dynamic": True, "size": (640, 640)}, "v8-last"),
    "v5": ("v5", {}, "v5"),
    "v5 with 1 class: 6 columns": ("v5", {"class_count": 1}, "v5"),
    "v5-tiny": ("v5", {"strides": (16, 32)}, "v5"),
    "v5 with dynamic shapes": ("v5", {"dynamic": True, "size": (640, 640)}, "v5"),
    "v6": ("v6", {}, "v5"),
    "v6 with 1 class: 6 columns": ("v6", {"class_count": 1}, "v5"),
    "yolox": ("yolox", {}, "yolox"),
    "yolox with 1 class: 6 columns": ("yolox", {"class_count": 1}, "yolox"),
    "yolox with names": ("yolox", {"names": True}, "yolox"),
    "yolox, decoded": ("yolox-decoded", {}, "v5"),
    "end2end": ("end2end", {}, "end2end"),
    "end2end with 300 of 525 cells": ("end2end", {"size": (160, 160)}, "end2end"),
    "v7-end2end": ("v7-end2end", {}, "v7-end2end"),
    "rt-detr": ("rt-detr", {}, "rt-detr"),
    "rt-detr with 2 classes: 6 columns": ("rt-detr", {"class_count": 2}, "rt-detr"),
    "rt-detr-end2end": ("rt-detr-end2end", {}, "rt-detr-end2end"),
    "rt-detr-end2end, 1 class": ("rt-detr-end2end", {"class_count": 1}, "rt-detr-end2end"),
    "rt-detr-end2end, 2 classes": ("rt-detr-end2end", {"class_count": 2}, "rt-detr-end2end"),
    "v4": ("v4", {}, "v4"),
    "v3 of the zoo": ("v3", {}, "v3"),
}  # fmt: skip


def _run(network: Network, layout: Layout) -> list[Any]:
    width, height = layout.input_size
    axes = (height, width, 3) if layout.channels_last else (3, height, width)
    return network.run(np.zeros((network.image.shape[0] or 1, *axes), np.float32))


def _assert_known(layout: Layout, outputs: list[Any], known: KnownBoxes, image: int = 0) -> None:
    found = decode(layout, outputs, image, 0.25)
    order = np.argsort(-found.scores)
    np.testing.assert_allclose(found.boxes_px[order], known.boxes, atol=1e-3)
    np.testing.assert_array_equal(found.class_ids[order], known.class_ids)
    np.testing.assert_allclose(found.scores[order], known.scores, atol=1e-5)
    assert found.boxes_px.dtype == np.float64
    assert found.class_ids.dtype == np.int64


@pytest.mark.parametrize(("kind", "options", "expected"), _GRAPHS.values(), ids=_GRAPHS)
def test_the_layout_and_its_boxes_are_found(
    kind: str, options: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    options = {"size": _SMALL, **options}
    classes = options.get("class_count", 80)
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, **options))
    layout = identify(network)
    assert layout.name == expected
    assert layout.input_size == options["size"]
    assert "end2end" in kind or len(layout.class_names) == classes
    assert layout.channels_last == options.get("channels_last", False)
    _assert_known(layout, _run(network, layout), known_boxes(classes, options["size"]))


@pytest.mark.parametrize("kind", ["v5-grid", "v7-grid", "v4-grid"])
def test_raw_grids_are_read_when_asked_for(kind: str, tmp_path: Path) -> None:
    size = (416, 448)  # where no box is more than four times its anchor
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=size))
    with pytest.raises(InputError, match=f"raw grids.*'{kind}'"):
        identify(network)
    layout = identify(network, layout=kind)
    assert len(layout.class_names) == 80
    _assert_known(layout, _run(network, layout), known_boxes(80, size))


@pytest.mark.parametrize("kind", ["v8", "v5", "yolox", "end2end", "rt-detr"])
def test_half_precision(kind: str, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SMALL, dtype="float16"))
    layout = identify(network)
    found = decode(layout, _run(network, layout), 0, 0.25)
    assert layout.name == kind
    order = np.argsort(-found.scores)
    # Half precision counts in quarters of a pixel there.
    np.testing.assert_allclose(found.boxes_px[order], known_boxes(80, _SMALL).boxes, atol=0.3)


@pytest.mark.parametrize("kind", ["v8", "v8-last", "v5", "yolox", "end2end", "rt-detr", "v4", "v3"])
def test_each_image_of_a_batch_has_its_boxes(kind: str, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SMALL, batch=3))
    layout = identify(network)
    outputs = _run(network, layout)
    if kind != "v3":
        first = np.flatnonzero([o.ndim >= 3 for o in outputs])
        for at in first:
            outputs[at] = np.stack([np.zeros_like(outputs[at][0]), *outputs[at][1:]])
        assert len(decode(layout, outputs, 0, 0.25)) == 0
        _assert_known(layout, outputs, known_boxes(80, _SMALL), 2)
    else:
        _assert_known(layout, outputs, known_boxes(80, _SMALL), 0)
        assert len(decode(layout, outputs, 2, 0.25)) == 0


def test_rows_of_other_images_stay_out(tmp_path: Path) -> None:
    rows = [[0, 1, 2, 30, 40, 5, 0.9], [1, 3, 4, 50, 60, 6, 0.8]]
    graph = write_graph(tmp_path / "n.onnx", {"output": np.array(rows)}, rows="n")
    layout = identify(open_network(graph))
    found = decode(layout, [np.array(rows)], 1, 0.25)
    np.testing.assert_array_equal(found.boxes_px, [[3, 4, 50, 60]])


def test_tiny_yolov3_of_the_zoo_has_indices_with_a_batch_axis(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "v3", size=_SMALL))
    boxes, scores, indices = _run(network, identify(network))
    outputs = {"boxes": boxes, "scores": scores, "indices": indices[None]}
    graph = write_graph(
        tmp_path / "t.onnx", outputs, image=[1, 3, 192, 320], image_shape_input=True
    )
    tiny = open_network(graph)
    layout = identify(tiny)
    assert layout.name == "v3"
    _assert_known(layout, _run(tiny, layout), known_boxes(80, _SMALL))


def test_old_yolov5_has_raw_grids_behind_its_table(tmp_path: Path) -> None:
    decoded = open_network(yolo_graph(tmp_path / "a.onnx", "v5", size=_SMALL))
    raw = open_network(yolo_graph(tmp_path / "b.onnx", "v5-grid", size=_SMALL))
    picture = np.zeros((1, 3, _SMALL[1], _SMALL[0]), np.float32)
    outputs = dict(zip("abcd", decoded.run(picture) + raw.run(picture), strict=True))
    network = open_network(
        write_graph(tmp_path / "n.onnx", outputs, image=[1, 3, _SMALL[1], _SMALL[0]])
    )
    layout = identify(network)
    assert layout.name == "v5"
    _assert_known(layout, network.run(picture), known_boxes(80, _SMALL))


def test_yolov7_with_one_class_scores_by_its_objectness(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "v5", size=_SMALL, class_count=1))
    layout = identify(network)
    table = _run(network, layout)[0].copy()
    table[..., 5] = 0.5
    np.testing.assert_allclose(decode(layout, [table], 0, 0.25).scores, 0.96, atol=1e-6)


def test_nothing_found_is_no_boxes(tmp_path: Path) -> None:
    embedded = write_graph(tmp_path / "a.onnx", {"output0": np.zeros((1, 300, 6))})
    listed = write_graph(tmp_path / "b.onnx", {"output": np.zeros((0, 7))}, rows="n")
    for path, name in ((embedded, "end2end"), (listed, "v7-end2end")):
        network = open_network(path)
        layout = identify(network)
        assert layout.name == name
        assert len(decode(layout, _run(network, layout), 0, 0.0)) == 0


@pytest.mark.parametrize(
    ("kind", "pixels", "fit", "pad", "nms"),
    [
        ("v8", PixelFormat("rgb", 1 / 255), "centre", 114, True),
        ("v6", PixelFormat("rgb", 1 / 255), "centre", 114, True),
        ("yolox", PixelFormat("bgr", 1.0), "corner", 114, True),
        ("yolox-decoded", PixelFormat("bgr", 1.0), "corner", 114, True),
        ("end2end", PixelFormat("rgb", 1 / 255), "centre", 114, False),
        ("v7-end2end", PixelFormat("rgb", 1 / 255), "centre", 114, False),
        ("rt-detr", PixelFormat("rgb", 1 / 255), "stretch", 114, False),
        ("rt-detr-end2end", PixelFormat("rgb", 1 / 255), "stretch", 114, False),
        ("v4", PixelFormat("rgb", 1 / 255), "stretch", 114, True),
        ("v3", PixelFormat("rgb", 1 / 255), "centre", 128, False),
    ],
)
def test_each_family_has_its_input(
    kind: str, pixels: PixelFormat, fit: str, pad: int, nms: object, tmp_path: Path
) -> None:
    layout = identify(open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SMALL)))
    assert (layout.pixels, layout.fit, layout.pad, layout.needs_nms) == (pixels, fit, pad, nms)


def test_pixels_as_asked_for_and_as_bytes(tmp_path: Path) -> None:
    floats = open_network(yolo_graph(tmp_path / "a.onnx", "v8", size=_SMALL))
    bytes_ = open_network(yolo_graph(tmp_path / "b.onnx", "v8", size=_SMALL, dtype="uint8"))
    assert identify(floats, pixels="bgr255").pixels == PixelFormat("bgr", 1.0)
    assert identify(bytes_).pixels == PixelFormat("rgb", 1.0)
    with pytest.raises(UsageError, match="rgb255"):
        identify(bytes_, pixels="rgb1")
    with pytest.raises(UsageError, match="no pixel format 'grey'"):
        identify(floats, pixels="grey")


def test_class_names_come_from_the_user_then_metadata_then_coco(tmp_path: Path) -> None:
    named = open_network(yolo_graph(tmp_path / "a.onnx", "v8", size=_SMALL, names=True))
    unnamed = open_network(yolo_graph(tmp_path / "b.onnx", "v8", size=_SMALL))
    seven = open_network(yolo_graph(tmp_path / "c.onnx", "v8", size=_SMALL, class_count=7))
    own = [f"mine {k}" for k in range(80)]
    assert identify(named, class_names=own).class_names == tuple(own)
    assert identify(named).class_names[79] == "thing 79"
    assert identify(unnamed).class_names == coco_names()
    numbered = identify(seven)
    assert numbered.class_names == tuple(f"class_{k}" for k in range(7))
    assert any("numbered" in why for why in numbered.why)


@pytest.mark.parametrize(
    "text", ["{0: 'car', 2: 'bus'}", "__import__('os')", "[" * 5000, "['a', 'a']", "{0: ''}", "x"]
)
def test_malformed_names_in_metadata_are_not_used(text: str, tmp_path: Path) -> None:
    graph = yolo_graph(tmp_path / "n.onnx", "v8", size=_SMALL, metadata={"names": text})
    layout = identify(open_network(graph))
    # Not even COCO's: the network has names, which are not known.
    assert layout.class_names == tuple(f"class_{k}" for k in range(80))
    assert any(why.startswith("classes: numbered") and "(" in why for why in layout.why)


def test_the_input_size_of_a_dynamic_network(tmp_path: Path) -> None:
    plain = open_network(yolo_graph(tmp_path / "a.onnx", "v8", dynamic=True))
    told = {"imgsz": "[384, 672]", "stride": "64"}
    hinted = open_network(yolo_graph(tmp_path / "b.onnx", "v8", dynamic=True, metadata=told))
    assert identify(plain).input_size == (640, 640)
    absurd = {"imgsz": "[99999, 99999]", "stride": "'x'"}
    silly = open_network(yolo_graph(tmp_path / "c.onnx", "v8", dynamic=True, metadata=absurd))
    assert identify(silly).input_size == (640, 640)
    assert identify(plain, input_size=(1600, 1088)).input_size == (1600, 1088)
    assert identify(hinted).input_size == (672, 384)
    with pytest.raises(UsageError, match=r"no multiple of 32 pixels.*Take 992 x 608"):
        identify(plain, input_size=(1000, 600))
    with pytest.raises(UsageError, match="no multiple of 64 pixels"):
        identify(hinted, input_size=(672, 384))


def test_a_fixed_input_size_cannot_be_changed(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "v8", size=_SMALL))
    assert identify(network, input_size=_SMALL).input_size == _SMALL
    with pytest.raises(UsageError, match="takes 320 x 192 only"):
        identify(network, input_size=(640, 640))


def test_the_resolved_decoding_says_why(tmp_path: Path) -> None:
    layout = identify(open_network(yolo_graph(tmp_path / "n.onnx", "v8", size=_SMALL)))
    assert [w.split(":")[0] for w in layout.why] == ["layout", "input", "classes", "pixels"]
    assert "1260 cells of the strides 8, 16, 32" in layout.why[0]


def test_yolox_nano(shared_data: Path) -> None:
    layout = identify(open_network(shared_data / "yolo" / "yolox_nano" / "yolox_nano.onnx"))
    assert layout.name == "yolox"
    assert layout.input_size == (416, 416)
    assert layout.pixels == PixelFormat("bgr", 1.0)
    assert layout.fit == "corner"
    assert layout.class_names == coco_names()
