"""Tiny ONNX networks that put out known boxes in every layout that detectors use.

A graph adds its image, times zero, to constant tensors: it runs in a millisecond, takes any batch,
and what it must be read as is known. `yolo_graph` writes one layout with given boxes,
`write_graph` one with any tensors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from onnx_layouts import ENCODERS, Cells, KnownBoxes, Output, known_boxes

__all__ = ["KnownBoxes", "known_boxes", "write_graph", "yolo_graph"]

Fires = Literal["always", "0..255", "0..1"]


@dataclass
class _Nodes:
    """Nodes and constants of a graph that is being made."""

    nodes: list[onnx.NodeProto] = field(default_factory=list)
    constants: list[onnx.TensorProto] = field(default_factory=list)

    def constant(self, array: NDArray[Any] | float | list[float]) -> str:
        name = f"constant{len(self.constants)}"
        held = np.asarray(array)
        held = held if held.dtype.kind in "iu" else held.astype(np.float32)
        self.constants.append(numpy_helper.from_array(held, name))
        return name

    def add(self, op: str, *inputs: str, **attributes: Any) -> str:
        name = f"{op.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, list(inputs), [name], **attributes))
        return name


def write_graph(
    path: Path,
    outputs: Mapping[str, NDArray[Any] | Output],
    *,
    image: Sequence[int | str] = (1, 3, 640, 640),
    input_name: str = "images",
    dtype: str = "float32",
    metadata: Mapping[str, str] | None = None,
    image_shape_input: bool = False,
    rows: str | None = None,
    grid_strides: Sequence[int] = (),
    fires: Fires = "always",
    opset: int = 17,
    ir_version: int = 8,
) -> Path:
    """Write a network that puts out `outputs`, whatever it sees.

    Args:
        path: Where to.
        outputs: Tensors by name, each with a batch axis of length 1 that follows the input's
            batch. Integer tensors are put out as they are.
        image: Shape of the image input; a word is a dynamic axis.
        input_name: Of the image input.
        dtype: Of the image input and of the float outputs.
        metadata: Goes into `metadata_props`.
        image_shape_input: Whether it has the second input of the model zoo's YOLOv3.
        rows: Name of the first axis of outputs of rank 2, if their number of rows varies.
        grid_strides: For a network with dynamic height and width: the one output of K boxes gets
            as many boxes as these strides have cells, zeros after the first K. Strides may be
            repeated, for anchors.
        fires: On which range of pixel values the `scores` of outputs show.
        opset: Of the graph.
        ir_version: Of the file.
    """
    g = _Nodes()
    x = g.add("Cast", input_name, to=TensorProto.FLOAT)
    mean = g.add("ReduceMean", x, axes=[1, 2, 3], keepdims=1)
    zero = g.add("Mul", mean, g.constant([0.0]))
    gate = _gate(g, x, fires)
    infos = []
    for name, output in outputs.items():
        made = output if isinstance(output, Output) else Output(output)
        if grid_strides:
            total = _gridded(g, made, x, gate, grid_strides)
        elif rows is not None and made.values.ndim == 2:
            total = _listed(g, made.values, zero)
        else:
            total = _constant(g, made, zero, gate)
        kind = helper.np_dtype_to_tensor_dtype(_np_dtype(made.values, dtype))
        g.nodes.append(helper.make_node("Cast", [total], [name], to=kind))
        shape = _declared(made, image[0], rows, grid_strides)
        infos.append(helper.make_tensor_value_info(name, kind, shape))
    kind = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
    inputs = [helper.make_tensor_value_info(input_name, kind, list(image))]
    if image_shape_input:
        inputs.append(helper.make_tensor_value_info("image_shape", TensorProto.FLOAT, [1, 2]))
    graph = helper.make_graph(g.nodes, "graph", inputs, infos, g.constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)])
    model.ir_version = ir_version
    helper.set_model_props(model, dict(metadata or {}))
    path.write_bytes(model.SerializeToString())
    return path


def _gate(g: _Nodes, x: str, fires: Fires) -> str | None:
    if fires == "always":
        return None
    brightest = g.add("ReduceMax", x, axes=[1, 2, 3], keepdims=1)
    bright = g.add("Greater", brightest, g.constant([1.5]))
    seen = bright if fires == "0..255" else g.add("Not", bright)
    return g.add("Cast", seen, to=TensorProto.FLOAT)


def _np_dtype(values: NDArray[Any], dtype: str) -> np.dtype[Any]:
    if values.dtype.kind in "iu":
        return values.dtype
    return np.dtype("float32" if dtype == "uint8" else dtype)


def _declared(
    output: Output, batch: int | str, rows: str | None, grid: Sequence[int]
) -> list[int | str]:
    shape: list[int | str] = list(output.values.shape)
    if rows is not None and len(shape) == 2:
        return [rows, *shape[1:]]
    if grid:
        shape[2 if output.cells_last else 1] = "cells"
    return [batch, *shape[1:]]


def _constant(g: _Nodes, output: Output, zero: str, gate: str | None) -> str:
    if output.values.dtype.kind in "iu":
        return g.constant(output.values)
    shape = g.constant(np.array([0] + [1] * (output.values.ndim - 1)))
    return g.add("Add", _fired(g, output, gate, shape), g.add("Reshape", zero, shape))


def _fired(g: _Nodes, output: Output, gate: str | None, shape: str) -> str:
    values = g.constant(output.values)
    if output.scores is None:
        return values
    scores = g.constant(output.scores)
    if gate is not None:
        scores = g.add("Mul", scores, g.add("Reshape", gate, shape))
    return g.add("Add", values, scores)


def _listed(g: _Nodes, values: NDArray[Any], zero: str) -> str:
    """Return the rows of a table whose number cannot be told from the graph."""
    count = g.add("Add", g.add("ReduceMax", zero, keepdims=0), g.constant(float(len(values))))
    end = g.add("Reshape", g.add("Cast", count, to=TensorProto.INT64), g.constant(np.array([1])))
    return g.add("Slice", g.constant(values), g.constant(np.array([0])), end)


def _gridded(g: _Nodes, output: Output, x: str, gate: str | None, strides: Sequence[int]) -> str:
    assert output.scores is not None
    by_cell = output
    if output.cells_last:
        by_cell = Output(output.values.transpose(0, 2, 1), output.scores.transpose(0, 2, 1))
    zeros = _grid_zeros(g, x, strides)
    held = _fired(g, by_cell, gate, g.constant(np.array([0, 1, 1])))
    total = g.add("Add", _padded(g, held, zeros), zeros)
    return g.add("Transpose", total, perm=[0, 2, 1]) if output.cells_last else total


def _grid_zeros(g: _Nodes, x: str, strides: Sequence[int]) -> str:
    grey = g.add("ReduceMean", x, axes=[1], keepdims=1)
    shape = g.constant(np.array([0, -1, 1]))
    cells = [
        g.add("Reshape", g.add("MaxPool", grey, kernel_shape=[s, s], strides=[s, s]), shape)
        for s in strides
    ]
    return g.add("Mul", g.add("Concat", *cells, axis=1), g.constant([0.0]))


def _padded(g: _Nodes, held: str, zeros: str) -> str:
    missing = g.add("Sub", g.add("Shape", zeros), g.add("Shape", held))
    after = g.add("Mul", missing, g.constant(np.array([0, 1, 0])))
    pads = g.add("Concat", g.constant(np.array([0, 0, 0])), after, axis=0)
    return g.add("Pad", held, pads)


def yolo_graph(
    path: Path,
    layout: str,
    known: KnownBoxes | None = None,
    *,
    class_count: int = 80,
    size: tuple[int, int] = (640, 640),
    strides: Sequence[int] = (8, 16, 32),
    batch: int | str = 1,
    dynamic: bool = False,
    names: bool = False,
    metadata: Mapping[str, str] | None = None,
    channels_last: bool = False,
    dtype: str = "float32",
    fires: Fires = "always",
    input_name: str = "images",
) -> Path:
    """Write a network that finds known boxes and puts them out in one of the layouts.

    Args:
        path: Where to.
        layout: As in `percept.detection.networks.layout`; `v6` is `v5` on one anchor a cell,
            `yolov3-zoo`
            and the like are not known here.
        known: What it finds; `known_boxes` by default.
        class_count: Of the network.
        size: (width, height) of its input.
        strides: Of its grids.
        batch: Fixed batch, or a word for a dynamic one.
        dynamic: Whether height and width are dynamic (`v8`, `v8-last`, `v5`).
        names: Whether its metadata hold class names `thing 0`.. as ultralytics writes them.
        metadata: More metadata.
        channels_last: Whether its input is NHWC.
        dtype: Of the input and the outputs: float32, float16 or uint8 (then outputs are float32).
        fires: On which pixel values it finds anything.
        input_name: Of the image input.
    """
    found = known or known_boxes(class_count, size)
    hw: list[int | str] = ["height", "width"] if dynamic else [size[1], size[0]]
    image = [batch, *hw, 3] if channels_last else [batch, 3, *hw]
    props = dict(metadata or {})
    if names:
        props["names"] = repr({i: f"thing {i}" for i in range(class_count)})
    grid = list(strides) * (3 if layout == "v5" else 1) if dynamic else ()
    cells = None if dynamic else Cells(size, strides)
    return write_graph(
        path,
        ENCODERS[layout](found, class_count, cells, size),
        image=image,
        input_name=input_name,
        dtype=dtype,
        metadata=props,
        image_shape_input=layout == "v3",
        rows="rows" if layout in ("v7-end2end", "v3") else None,
        grid_strides=grid,
        fires=fires,
    )
