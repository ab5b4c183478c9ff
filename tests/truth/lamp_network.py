"""A small network with layers that really finds something: lamps, bright squares of 8 pixels.

It has the layout of YOLOv8 with one class and an input of 64 x 64. Each cell of 8 pixels is as
sure of a lamp as it is bright; the coarser cells never are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

__all__ = ["lamp_network", "lamp_picture", "write_lamp_pictures"]

_STRIDES = (8, 16, 32)
_SIZE = 64
_CHANNELS = 4


def lamp_network(
    path: Path, *, opset: int = 17, half: bool = False, metadata: dict[str, str] | None = None
) -> Path:
    """Write the network; with `half`, its weights are float16 and cast where they are used."""
    weights: dict[str, NDArray[Any]] = {
        "grey": np.full((_CHANNELS, 3, 1, 1), 1 / 3, np.float32),
        "mean8": _means(8),
        "mean16": _means(2),
        "mean32": _means(2),
        "sure": np.full((1, _CHANNELS, 1, 1), 16 / _CHANNELS, np.float32),
        "bias8": np.array([-11.0], np.float32),
        "never": np.array([-40.0], np.float32),
        "boxes": _boxes(),
        "row": np.array([1, 1, -1]),
    }
    nodes = [
        helper.make_node("Conv", ["images", "grey"], ["g"]),
        helper.make_node("Relu", ["g"], ["x4"]),
        *_scale("x4", "mean8", "x8", 8, "bias8"),
        *_scale("x8", "mean16", "x16", 2, "never"),
        *_scale("x16", "mean32", "x32", 2, "never"),
        helper.make_node("Concat", ["row_x8", "row_x16", "row_x32"], ["logits"], axis=2),
        helper.make_node("Sigmoid", ["logits"], ["scores"]),
        helper.make_node("Concat", ["boxes", "scores"], ["output0"], axis=1),
    ]
    if half:
        weights["grey"] = weights["grey"].astype(np.float16)
        nodes.insert(0, helper.make_node("Cast", ["grey"], ["grey32"], to=TensorProto.FLOAT))
        nodes[1].input[1] = "grey32"
    graph = helper.make_graph(
        nodes,
        "lamps",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, _SIZE, _SIZE])],
        [
            helper.make_tensor_value_info(
                "output0", TensorProto.FLOAT, [1, 5, weights["boxes"].shape[2]]
            )
        ],
        [numpy_helper.from_array(array, name) for name, array in weights.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    helper.set_model_props(model, metadata or {"names": "{0: 'lamp'}", "task": "detect"})
    onnx.save(model, str(path))
    return path


def _means(size: int) -> NDArray[np.float32]:
    """Return weights that take the mean of each channel over a square."""
    weight = np.zeros((_CHANNELS, _CHANNELS, size, size), np.float32)
    weight[range(_CHANNELS), range(_CHANNELS)] = 1 / size**2
    return weight


def _boxes() -> NDArray[np.float32]:
    columns = []
    for stride in _STRIDES:
        y, x = np.mgrid[: _SIZE // stride, : _SIZE // stride].reshape(2, -1)
        side = np.full(x.size, stride)
        columns.append(np.stack([(x + 0.5) * stride, (y + 0.5) * stride, side, side]))
    return np.concatenate(columns, axis=1)[None].astype(np.float32)


def _scale(source: str, weight: str, name: str, stride: int, bias: str) -> list[onnx.NodeProto]:
    """Return a layer that goes down to a scale, and the one that puts out its scores."""
    return [
        helper.make_node("Conv", [source, weight], [f"c_{name}"], strides=[stride, stride]),
        helper.make_node("Relu", [f"c_{name}"], [name]),
        helper.make_node("Conv", [name, "sure", bias], [f"p_{name}"]),
        helper.make_node("Reshape", [f"p_{name}", "row"], [f"row_{name}"]),
    ]


def lamp_picture(seed: int, lamps: int = 6) -> NDArray[np.uint8]:
    """Return a dark picture (64, 64, 3) with lamps, at most as many, in cells of the network."""
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 60, (_SIZE, _SIZE, 3), dtype=np.uint8)
    for x, y in rng.integers(0, _SIZE // 8, (lamps, 2)) * 8:
        picture[y : y + 8, x : x + 8] = rng.integers(200, 256, (8, 8, 3))
    return picture


def write_lamp_pictures(folder: Path, count: int, lamps: int = 6) -> Path:
    """Write pictures as a folder that can be read as a log."""
    folder.mkdir(parents=True)
    for seed in range(count):
        cv2.imwrite(str(folder / f"{seed:04d}.png"), lamp_picture(seed, lamps))
    return folder
