"""Networks that put out their objects and nothing else: zeros, where others have a background."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper
from onnx_graphs import known_boxes, write_graph
from onnx_layouts import ENCODERS, Cells, Output

from percept.core.errors import InputError
from percept.detection import YoloDetector
from percept.detection.networks.decode import decode
from percept.detection.networks.identify import identify
from percept.detection.networks.layout import Layout
from percept.detection.networks.network import open_network

_SIZE = (320, 192)
_IMAGE = [1, 3, _SIZE[1], _SIZE[0]]
_OBJECT = 0.2


def _everywhere(kind: str, classes: int = 80) -> Output:
    """Return the table of a layout with boxes in all cells."""
    cells = Cells(_SIZE, (8, 16, 32))
    (output,) = ENCODERS[kind](known_boxes(classes, _SIZE), classes, cells, _SIZE).values()
    assert isinstance(output, Output)
    assert output.scores is not None
    return Output(output.values + output.scores, cells_last=output.cells_last)


def _bare(kind: str, classes: int) -> Output:
    """Return the table of a layout with zeros in all rows but those of the known boxes."""
    output = _everywhere(kind, classes)
    table = output.values
    rows = table.transpose(0, 2, 1) if output.cells_last else table
    best = rows[..., 5:].max(2) if rows.shape[2] > 5 else 1.0
    alone = kind in ("v8", "v8-last")
    scores = rows[..., 4:].max(2) if alone else rows[..., 4] * best
    rows[scores < _OBJECT] = 0
    return output


def _identified(path: Path, outputs: dict[str, Any], **options: Any) -> tuple[Layout, list[Any]]:
    network = open_network(write_graph(path / "n.onnx", outputs, image=_IMAGE, **options))
    return identify(network), network.run(np.zeros(_IMAGE, np.float32))


@pytest.mark.parametrize("classes", [80, 3, 1])
@pytest.mark.parametrize(
    ("kind", "name", "fit"),
    [
        ("v8", "v8", "centre"),
        ("v8-last", "v8-last", "centre"),
        ("v5", "v5", "centre"),
        ("v6", "v5", "centre"),
        ("yolox-decoded", "v5", "corner"),
        ("yolox", "yolox", "corner"),
    ],
)
def test_objects_alone_tell_the_layout(
    kind: str, name: str, fit: str, classes: int, tmp_path: Path
) -> None:
    table = _bare(kind, classes)
    if (kind, classes) == ("v8-last", 3):
        with pytest.raises(InputError, match="'v8-last' with 3 classes or 'v5' with 2"):
            _identified(tmp_path, {"output": table})
        return
    layout, outputs = _identified(tmp_path, {"output": table})
    known = known_boxes(classes, _SIZE)
    assert (layout.name, layout.fit, len(layout.class_names)) == (name, fit, classes)
    found = decode(layout, outputs, 0, 0.25)
    order = np.argsort(-found.scores)
    np.testing.assert_allclose(found.boxes_px[order], known.boxes, atol=1e-3)
    np.testing.assert_array_equal(found.class_ids[order], known.class_ids)


def _one(kind: str, row: list[float], cell: int = 77) -> dict[str, NDArray[Any]]:
    """Return a table of 1260 cells of which one is not zero."""
    table = np.zeros((1, 1260, len(row)))
    table[0, cell] = row
    return {"output": table.transpose(0, 2, 1) if kind == "v8" else table}


def test_one_object_in_a_corner_is_enough(tmp_path: Path) -> None:
    near_the_origin = [20.0, 15.0, 30.0, 20.0]
    layout, _ = _identified(tmp_path, _one("v8", [*near_the_origin, 0.9, 0]))
    assert (layout.name, len(layout.class_names)) == ("v8", 2)
    layout, _ = _identified(tmp_path, _one("v6", [*near_the_origin, 1.0, 0.3, 0, 0]))
    assert (layout.name, layout.fit, len(layout.class_names)) == ("v5", "centre", 3)
    # In a cell that is not its own, and so with large offsets.
    layout, _ = _identified(tmp_path, _one("yolox", [12.0, 5.0, 2.5, 3.0, 0.9, 0.9, 0]))
    assert (layout.name, len(layout.class_names)) == ("yolox", 2)


@pytest.mark.parametrize("classes", [1, 80])
def test_an_angle_is_no_class(classes: int, tmp_path: Path) -> None:
    table = _bare("v8", classes).values
    angle = np.where(table[:, 4:].max(1, keepdims=True) > _OBJECT, 0.7, 0)
    outputs = {"output0": Output(np.concatenate([table, angle], 1), cells_last=True)}
    with pytest.raises(InputError, match="two classes at once: one is an objectness or an angle"):
        _identified(tmp_path, outputs)
    # Names for all of them say that it is a class.
    names = {"names": str([f"thing {k}" for k in range(classes + 1)])}
    assert _identified(tmp_path, outputs, metadata=names)[0].name == "v8"


@pytest.mark.parametrize("kind", ["v8", "v5"])
def test_boxes_in_shares_of_the_picture_are_refused(kind: str, tmp_path: Path) -> None:
    for output in (_bare(kind, 80), _everywhere(kind)):
        values = output.values if kind == "v5" else output.values.transpose(0, 2, 1)
        values[..., :4] /= [*_SIZE, *_SIZE]
        with pytest.raises(InputError, match=r"reach only 0\.\d+ pixels"):
            _identified(tmp_path, {"output": output})


@pytest.mark.parametrize("kind", ["v8", "yolox"])
@pytest.mark.parametrize("fires", ["0..1", "0..255"])
def test_silence_in_one_range_is_no_reason_to_refuse(kind: str, fires: Any, tmp_path: Path) -> None:
    table = _bare(kind, 80)
    gated = Output(np.zeros_like(table.values), table.values, cells_last=table.cells_last)
    layout, _ = _identified(tmp_path, {"output": gated}, fires=fires)
    assert layout.name == kind


def test_a_network_that_is_told_the_size_of_the_image_puts_boxes_there(tmp_path: Path) -> None:
    """As the model zoo's YOLOv3 does; this one says where the image ends, as y1, x1, y2, x2."""
    constants = {"zeros": np.zeros((1, 2)), "one": np.ones((1, 1, 1))}
    held = [onnx.numpy_helper.from_array(v.astype(np.float32), k) for k, v in constants.items()]
    held.append(onnx.numpy_helper.from_array(np.array([[0, 0, 0]], np.int32), "indices_held"))
    held.append(onnx.numpy_helper.from_array(np.array([1, 1, 4]), "shape"))
    nodes = [
        helper.make_node("Concat", ["zeros", "image_shape"], ["corners"], axis=1),
        helper.make_node("Reshape", ["corners", "shape"], ["boxes"]),
        helper.make_node("Identity", ["one"], ["scores"]),
        helper.make_node("Identity", ["indices_held"], ["indices"]),
    ]
    info, real = helper.make_tensor_value_info, TensorProto.FLOAT
    inputs = [info("input_1", real, [1, 3, 416, 416]), info("image_shape", real, [1, 2])]
    outputs = [
        info("boxes", real, [1, 1, 4]),
        info("scores", real, [1, 1, 1]),
        info("indices", TensorProto.INT32, [1, 3]),
    ]
    graph = helper.make_graph(nodes, "zoo", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save(model, tmp_path / "zoo.onnx")
    detector = YoloDetector(tmp_path / "zoo.onnx")
    (found,) = detector.detect([np.zeros((479, 641, 3), np.uint8)])
    assert detector.layout.name == "v3"
    np.testing.assert_array_equal(found.boxes_px, [[0, 0, 641, 479]])
