"""A network in 8-bit integers: faster on processors, and no longer quite the same network.

Static quantisation of onnxruntime (QDQ: activations uint8, weights int8 for each channel) of
convolutions and of the SiLU (x times its sigmoid) behind them: with that in floats, half of the
time would go into turning numbers there and back. The ranges of the activations come from images.
Some convolutions stay as they are, since they cost little time and much accuracy:

- those that the image goes into: the range of pixels tells nothing of the edges they look for;
- depthwise ones: nine weights a channel leave no room for errors to cancel;
- those that put out boxes and scores, and all behind them: box coordinates span the whole image,
  and in steps of a 256th of that boxes are of no use (onnxruntime issue 10787).
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import onnx
from numpy.typing import NDArray
from onnx import GraphProto, ModelProto, NodeProto, TensorProto
from onnxruntime.quantization import (
    CalibrationDataReader,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.shape_inference import quant_pre_process

from percept.core.errors import InputError, InsufficientDataError
from percept.detection.networks.network import Network

__all__ = ["QuantizedLayers", "layers_to_keep", "quantize_network"]

# Scales for each channel came with this version of ONNX's operations.
_LEAST_OPSET = 13
_QUANTIZED_OPS = frozenset(["QuantizeLinear", "ConvInteger", "QLinearConv"])
_SHAPE_OPS = frozenset(["Reshape", "Transpose", "Flatten", "Squeeze", "Unsqueeze"])


@dataclass(frozen=True, slots=True)
class QuantizedLayers:
    """What became of the convolutions of a network.

    Attributes:
        quantized: How many are in integers now.
        kept: How many were kept as they are, by reason.
        images: Images that the ranges of the activations come from.
    """

    quantized: int
    kept: dict[str, int]
    images: int


def quantize_network(
    network: Network, target: Path, tensors: Iterable[NDArray[Any]]
) -> QuantizedLayers:
    """Write a copy of a network in which convolutions work on 8-bit integers.

    Names of inputs and outputs, shapes and metadata stay the same.

    Args:
        network: The network in float32.
        target: The file to write.
        tensors: Inputs of the network, made from images as in use; read once, one by one.

    Raises:
        InputError: If the network is not in float32, or has nothing that can be quantised.
        InsufficientDataError: If there are no tensors.
    """
    model = onnx.load(str(network.path))
    _check(model, network)
    reader = _Reader(network.image.name, tensors)
    with tempfile.TemporaryDirectory(prefix="percept-") as folder:
        plain, prepared, done = (Path(folder) / f"{n}.onnx" for n in ("plain", "prepared", "done"))
        onnx.save(_modern(model, network.path), str(plain))
        # Symbolic shapes would need sympy, and tell nothing that convolutions ask for.
        quant_pre_process(str(plain), str(prepared), skip_symbolic_shape=True)
        graph = _named(prepared)
        kept = layers_to_keep(graph)
        layers = [n for n in graph.node if n.op_type == "Conv" and n.name not in kept]
        if not layers:
            raise InputError("no layer of it can be quantised", where=network.path)
        names = [node.name for node in (*layers, *_silus_behind(graph, layers))]
        _quantize(prepared, done, reader, names)
        quantized = onnx.load(str(done))
    del quantized.metadata_props[:]
    quantized.metadata_props.extend(model.metadata_props)
    onnx.save(quantized, str(target))
    return QuantizedLayers(len(layers), dict(Counter(kept.values())), reader.count)


def _check(model: ModelProto, network: Network) -> None:
    remedy = "Give the network as it was exported, in float32"
    if any(node.op_type in _QUANTIZED_OPS for node in model.graph.node):
        raise InputError("it is quantised already", where=network.path, remedy=remedy)
    kinds = {tensor.data_type for tensor in model.graph.initializer}
    if TensorProto.FLOAT16 in kinds or network.image.dtype != "float32":
        raise InputError("it is not in float32", where=network.path, remedy=remedy)
    if len(network.inputs) > 1:
        raise InputError(
            f"it has inputs besides the image: {'; '.join(map(str, network.inputs))}",
            where=network.path,
            remedy="Export it without",
        )


def _modern(model: ModelProto, path: Path) -> ModelProto:
    """Return the model with operations of a version that has scales for each channel."""
    opset = max((o.version for o in model.opset_import if o.domain in ("", "ai.onnx")), default=0)
    if opset >= _LEAST_OPSET:
        return model
    try:
        return onnx.version_converter.convert_version(model, _LEAST_OPSET)
    except (onnx.version_converter.ConvertError, RuntimeError) as error:
        raise InputError(
            f"it has operations of version {opset} that cannot be brought to {_LEAST_OPSET}",
            where=path,
            remedy=f"Export it with opset {_LEAST_OPSET} or later",
        ) from error


def _named(path: Path) -> GraphProto:
    """Give every node of a file a name, by which it can be left out, and return the graph."""
    model = onnx.load(str(path))
    for number, node in enumerate(model.graph.node):
        node.name = f"{node.op_type}_{number}"
    onnx.save(model, str(path))
    return model.graph


class _Reader(CalibrationDataReader):  # type: ignore[misc]  # onnxruntime has no types
    """Hands tensors to onnxruntime, one by one, and counts them."""

    def __init__(self, name: str, tensors: Iterable[NDArray[Any]]) -> None:
        self._name = name
        self._tensors = iter(tensors)
        self.count = 0

    def get_next(self) -> dict[str, NDArray[Any]] | None:
        for tensor in self._tensors:
            self.count += 1
            return {self._name: tensor}
        if not self.count:
            raise InsufficientDataError("there are no images to take the ranges from")
        return None


def _quantize(source: Path, target: Path, reader: _Reader, names: list[str]) -> None:
    quantize_static(
        str(source),
        str(target),
        reader,
        quant_format=QuantFormat.QDQ,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        per_channel=True,
        op_types_to_quantize=["Conv", "Sigmoid", "Mul"],
        nodes_to_quantize=names,
    )


def layers_to_keep(graph: GraphProto) -> dict[str, str]:
    """Return the convolutions that stay in floats, by name, with the reason."""
    layers = {n.name: n for n in graph.node if n.op_type == "Conv"}
    kept = dict.fromkeys(_depthwise(graph, layers.values()), "depthwise")
    kept |= dict.fromkeys(_first_layers(graph), "sees pixels")
    decoding = {name for name, node in layers.items() if _follows_softmax(graph, node)}
    return kept | dict.fromkeys(_last_layers(graph, decoding), "puts out boxes or scores")


def _silus_behind(graph: GraphProto, layers: Iterable[NodeProto]) -> Iterator[NodeProto]:
    """Yield both nodes of each SiLU that follows one of these convolutions."""
    values = {node.output[0] for node in layers}
    gates = {n.output[0]: n for n in graph.node if n.op_type == "Sigmoid" and n.input[0] in values}
    for node in graph.node:
        gate = next((gates[name] for name in node.input if name in gates), None)
        if node.op_type == "Mul" and gate is not None and gate.input[0] in node.input:
            yield gate
            yield node


def _depthwise(graph: GraphProto, layers: Iterable[NodeProto]) -> Iterator[str]:
    shapes = {tensor.name: tensor.dims for tensor in graph.initializer}
    for node in layers:
        groups = next((a.i for a in node.attribute if a.name == "group"), 1)
        if groups > 1 and shapes.get(node.input[1], [0, 0])[1] == 1:
            yield node.name


def _first_layers(graph: GraphProto) -> Iterator[str]:
    """Yield the convolutions with no other one between the image and them."""
    pixels = {value.name for value in graph.input}
    for node in graph.node:
        if node.op_type == "Shape" or pixels.isdisjoint(node.input):
            continue
        if node.op_type == "Conv":
            yield node.name
        else:
            pixels.update(node.output)


def _last_layers(graph: GraphProto, decoding: set[str]) -> Iterator[str]:
    """Yield the convolutions with no other one behind them, but for those that only decode."""
    seen_by_layers: set[str] = set()
    for node in reversed(graph.node):
        onward = not seen_by_layers.isdisjoint(node.output)
        is_layer = node.op_type == "Conv" and node.name not in decoding
        if node.op_type == "Conv" and not onward:
            yield node.name
        if onward or is_layer:
            seen_by_layers.update(node.input)


def _follows_softmax(graph: GraphProto, node: NodeProto) -> bool:
    """Tell whether a convolution turns a distribution over distances into one (DFL of YOLOv8)."""
    makers = {name: maker for maker in graph.node for name in maker.output}
    maker = makers.get(node.input[0])
    while maker is not None and maker.op_type in _SHAPE_OPS:
        maker = makers.get(maker.input[0])
    return maker is not None and maker.op_type == "Softmax"
