"""What is ambiguous, broken or no detector is refused, with what was seen and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx_graphs import known_boxes, write_graph, yolo_graph

from percept.core.errors import InputError, UsageError
from percept.detection.networks.decode import decode
from percept.detection.networks.identify import identify
from percept.detection.networks.layout import Layout
from percept.detection.networks.network import open_network

_SIZE = (320, 192)
_CELLS = 1260
_IMAGE = [1, 3, _SIZE[1], _SIZE[0]]


def _v8_table(rows: int) -> np.ndarray[Any, Any]:
    """Return a plausible table of 4 + 1 rows, and further ones that are 0."""
    y, x = np.mgrid[:24, :40] * 8 + 4.0
    table = np.zeros((rows, _CELLS))
    table[0, :960], table[1, :960], table[2:4] = x.ravel(), y.ravel(), 20
    return table


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        ("v8-last", {"class_count": 81}, "'v8-last' with 81 classes or 'v5' with 80"),
        ("v8-last", {"class_count": 2}, "'v8-last' with 2 classes or 'v5' with 1"),
        ("v5-grid", {}, "'v5-grid' or 'v7-grid'"),
        ("v4-grid", {}, "'v4-grid'"),
    ],
)
def test_ambiguous(kind: str, options: dict[str, Any], says: str, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SIZE, **options))
    with pytest.raises(InputError) as refused:
        identify(network)
    assert says in str(refused.value)
    assert "for an input of 320 x 192" in str(refused.value)
    layout = identify(network, layout=kind)
    found = decode(layout, network.run(np.zeros(_IMAGE, np.float32)), 0, 0.25)
    known = known_boxes(len(layout.class_names), _SIZE)
    np.testing.assert_allclose(np.sort(found.scores), np.sort(known.scores), atol=1e-5)


@pytest.mark.parametrize("names", [1, 2])
def test_the_number_of_names_settles_a_collision(names: int, tmp_path: Path) -> None:
    graph = yolo_graph(tmp_path / "n.onnx", "v8-last", size=_SIZE, class_count=2)
    layout = identify(open_network(graph), class_names=["car", "bus"][:names])
    assert layout.name == ("v5", "v8-last")[names - 1]


def _negative_sizes() -> dict[str, np.ndarray[Any, Any]]:
    table = _v8_table(84)
    table[2:4] = -5
    return {"output0": table[None]}


def _list_with(column: int, value: float) -> dict[str, np.ndarray[Any, Any]]:
    rows = _finished(6)
    rows["output0"][0, :200, 5] = 1
    rows["output0"][0, :200, column] = value
    return rows


def _masks() -> dict[str, np.ndarray[Any, Any]]:
    return {"output0": _v8_table(37)[None], "output1": np.zeros((1, 32, 48, 80))}


def _angles() -> dict[str, np.ndarray[Any, Any]]:
    table = _v8_table(20)
    table[-1] = np.linspace(0.3, 0.9, _CELLS)
    return {"output0": table[None]}


def _poses() -> dict[str, np.ndarray[Any, Any]]:
    table = _v8_table(56)
    table[5:] = 100
    return {"output0": table[None]}


def _finished(columns: int) -> dict[str, np.ndarray[Any, Any]]:
    rows = np.zeros((1, 250, columns))
    rows[0, :2, :6] = [[10, 10, 200, 90, 0.9, 3], [50, 20, 90, 60, 0.8, 1]]
    return {"output0": rows}


@pytest.mark.parametrize(
    ("outputs", "metadata", "says"),
    [
        (_masks(), {}, "segmentation"),
        (_masks(), {"task": "segment"}, "for segmentation"),
        (_angles(), {}, "objects in a plain grey picture"),
        (_angles(), {"task": "obb"}, "for rotated boxes"),
        (_angles(), {"names": str([f"c{k}" for k in range(15)])}, "plain grey picture"),
        (_poses(), {}, "class probabilities would be 0 to 100"),
        (_poses(), {"task": "pose"}, "for pose"),
        (_finished(38), {}, "no share of a picture"),
        (_finished(57), {}, "no share of a picture"),
        (_finished(7), {}, "no share of a picture"),
        (_negative_sizes(), {}, "sizes down to -5 pixels"),
        (_list_with(5, 2.5), {}, "its last column is no class number"),
        (_list_with(5, 1e12), {}, "its last column is no class number"),
        (_list_with(2, -9), {}, "its boxes would have negative sizes"),
        (_list_with(4, 3.25), {}, "its scores would be 0 to 3.25"),
        ({"logits": np.ones((1, 1000))}, {}, "classifier"),
        ({"probabilities": np.full((1, 7), 1 / 7)}, {}, "classifier"),
        ({"depth": np.ones((1, 1, 192, 320))}, {}, "raw grids"),
        ({"table": np.ones((1, 1234, 4567))}, {}, "no layout has such a shape"),
        ({"table": np.ones((1, 123, 456))}, {}, "123 objects in a plain grey"),
        ({"a": np.ones((1, 300, 4)), "b": np.ones((1, 300, 80))}, {}, "several tables"),
        ({"num_dets": np.ones((1, 1)), "det_boxes": np.ones((1, 100, 4)),
          "det_scores": np.ones((1, 100)), "det_classes": np.ones((1, 100))}, {}, "TensorRT"),
        ({"output0": np.full((1, 84, _CELLS), np.nan)}, {}, "infinite numbers or none"),
        ({"output0": np.zeros((1, 84, _CELLS))}, {}, "reach only to 0, 0 pixels"),
    ],
)  # fmt: skip
def test_no_detector(
    outputs: dict[str, Any], metadata: dict[str, str], says: str, tmp_path: Path
) -> None:
    graph = write_graph(tmp_path / "n.onnx", outputs, image=_IMAGE, metadata=metadata)
    with pytest.raises(InputError) as refused:
        identify(open_network(graph))
    assert says in str(refused.value)
    assert "n.onnx" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("kind", "classes"), [("v8", 16), ("v5", 7), ("yolox", 80), ("v4", 3)])
def test_wrong_number_of_names(kind: str, classes: int, tmp_path: Path) -> None:
    graph = yolo_graph(
        tmp_path / "n.onnx", kind, size=_SIZE, class_count=classes,
        metadata={"names": str({k: f"c{k}" for k in range(15)})},
    )  # fmt: skip
    network = open_network(graph)
    with pytest.raises(InputError, match=f"has {classes} classes .*metadata name 15"):
        identify(network)
    with pytest.raises(UsageError, match=f"has {classes} classes .*, but 2 class names"):
        identify(network, class_names=["a", "b"])
    own = [f"own {k}" for k in range(classes)]
    assert identify(network, class_names=own).class_names == tuple(own)


def test_finished_boxes_with_too_few_names(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "end2end", size=_SIZE))
    with pytest.raises(UsageError, match=r"has 80 classes .*, but 2 class names"):
        identify(network, class_names=["a", "b"])
    layout = Layout("end2end", ("a", "b"), _SIZE)
    with pytest.raises(InputError, match="class 79, but 2 class names"):
        decode(layout, network.run(np.zeros(_IMAGE, np.float32)), 0, 0.25)


@pytest.mark.parametrize("asked", ["yolox", "v4", "v5-grid", "v7-end2end", "end2end", "v3"])
def test_a_layout_that_cannot_be(asked: str, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "v8", size=_SIZE))
    with pytest.raises(UsageError, match=f"cannot be of the layout '{asked}'.*allow: v8"):
        identify(network, layout=asked)


def test_an_unknown_layout(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "v8", size=_SIZE))
    with pytest.raises(UsageError, match=r"no layout 'yolo-x'. Did you mean 'yolox'"):
        identify(network, layout="yolo-x")


def test_a_layout_that_is_forced_says_what_speaks_against_it(tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", "yolox", size=_SIZE))
    layout = identify(network, layout="v5")
    assert "although its boxes would" in layout.why[0]


@pytest.mark.parametrize(
    "kind", ["v8", "v8-last", "v5", "yolox", "end2end", "rt-detr", "rt-detr-end2end", "v4"]
)
@pytest.mark.parametrize("bad", [np.nan, np.inf, 7.5])
def test_numbers_that_are_no_scores(kind: str, bad: float, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SIZE))
    layout = identify(network)
    outputs = [np.where(np.isclose(o, 0.91), bad, o) for o in _widened(network, kind)]
    with pytest.raises(InputError, match=f"where the layout '{kind}' has boxes"):
        decode(layout, outputs, 0, 0.25)


@pytest.mark.parametrize("kind", ["v8", "yolox", "end2end"])
def test_a_box_that_is_no_number(kind: str, tmp_path: Path) -> None:
    network = open_network(yolo_graph(tmp_path / "n.onnx", kind, size=_SIZE))
    layout = identify(network)
    outputs = [np.array(o) for o in network.run(np.zeros(_IMAGE, np.float32))]
    (outputs[0][:, 2] if kind == "v8" else outputs[0][..., 2])[:] = np.inf
    with pytest.raises(InputError, match="infinite"):
        decode(layout, outputs, 0, 0.25)


def _widened(network: Any, kind: str) -> list[Any]:
    """Return the outputs with the first object's class score as 0.91 where it is a factor."""
    outputs: list[Any] = network.run(np.zeros(_IMAGE, np.float32))
    factor = 0.96 if kind in ("v5", "yolox") else 1
    return [np.where(np.isclose(o, 0.91 / factor), 0.91, o) for o in outputs]


def test_a_dynamic_network_of_one_size_is_read_at_that_size(tmp_path: Path) -> None:
    # The table has the cells of 320 x 192, whatever comes in.
    graph = write_graph(
        tmp_path / "n.onnx", {"output0": _v8_table(84)[None]}, image=[1, 3, "h", "w"]
    )
    with pytest.raises(InputError, match=r"as a detector.*for an input of 640 x 640"):
        identify(open_network(graph))
    assert identify(open_network(graph), input_size=_SIZE).name == "v8"
