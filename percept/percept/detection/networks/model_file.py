"""What an ONNX file holds, checked before onnxruntime opens it.

A model may come from anywhere. It is parsed here without its external data: a file that points
outside of its own folder, or needs operations that no onnxruntime has, is refused with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import onnx
from google.protobuf.message import DecodeError
from onnx import FunctionProto, GraphProto, ModelProto, NodeProto, TensorProto

from percept.core.errors import InputError

__all__ = ["ModelFile", "any_size_model", "read_model_file"]

# A protobuf message cannot be larger; larger networks keep their weights in files beside it.
_MAX_BYTES = 2**31 - 1
_MAX_DIGITS = 20  # of a number of bytes; onnxruntime judges what is longer
_DOMAINS = frozenset(
    ["", "ai.onnx", "ai.onnx.ml", "com.microsoft", "com.microsoft.nchwc", "com.ms.internal.nhwc"]
)


@dataclass(frozen=True, slots=True)
class ModelFile:
    """Facts of an ONNX file that may be opened.

    Attributes:
        metadata: The `metadata_props` of the file.
        ir_version: Version of the file format.
        opset: Version of ONNX's own operations.
    """

    metadata: dict[str, str]
    ir_version: int
    opset: int


def read_model_file(path: Path) -> ModelFile:
    """Read the facts of an ONNX file, and refuse one that must not or cannot be opened.

    Raises:
        InputError: If there is no such file; it is truncated or no ONNX network; it keeps weights
            outside of its folder or in a file that is missing or too short; or it has operations
            that are not part of ONNX, such as those of TensorRT.
    """
    model = _parse(path)
    for node in _nodes(model.graph):
        _check_operation(path, node, model)
    for tensor in _tensors(model):
        if tensor.data_location == TensorProto.EXTERNAL:
            _check_external(path, tensor)
    opsets = [o.version for o in model.opset_import if o.domain in ("", "ai.onnx")]
    metadata = {_text(p.key): _text(p.value) for p in model.metadata_props}
    return ModelFile(metadata, model.ir_version, max(opsets, default=0))


def any_size_model(path: Path) -> bytes:
    """Return an ONNX network as bytes in which images may have any size and number.

    For networks of convolutions alone whose file names the sizes that they were traced with.
    Batch, height and width of inputs and outputs with four axes become free. The file is not
    changed.

    Raises:
        InputError: As for `read_model_file`.
    """
    model = _parse(path)
    weights = {tensor.name for tensor in model.graph.initializer}
    for value in (*model.graph.input, *model.graph.output):
        axes = value.type.tensor_type.shape.dim
        if value.name not in weights and len(axes) == 4:
            for number in (0, 2, 3):
                axes[number].dim_param = f"{value.name}_{number}"
    del model.graph.value_info[:]
    content: bytes = model.SerializeToString()
    return content


def _parse(path: Path) -> ModelProto:
    if path.is_dir():
        raise InputError("this is a folder", where=path, remedy="Give an ONNX file")
    if not path.is_file():
        raise InputError("there is no such file", where=path, remedy="Give an ONNX file")
    size = path.stat().st_size
    if size > _MAX_BYTES:
        raise InputError(
            f"{size / 2**30:.1f} GiB are more than an ONNX file can hold",
            where=path,
            remedy="Export the network with external data",
        )
    try:
        model = onnx.load_model_from_string(path.read_bytes())
    except DecodeError as e:
        raise _not_a_network(path, size) from e
    except OSError as e:
        raise InputError(f"cannot be read ({e.strerror})", where=path) from e
    if not model.graph.node or not model.graph.output:
        raise _not_a_network(path, size)
    return model


def _not_a_network(path: Path, size: int) -> InputError:
    return InputError(
        f"this is not a whole ONNX network ({size} bytes)",
        where=path,
        remedy="Copy or export it again; a .pt or .engine file must be exported to ONNX first",
    )


def _subgraphs(node: NodeProto) -> Iterator[GraphProto]:
    for attribute in node.attribute:
        if attribute.HasField("g"):
            yield attribute.g
        yield from attribute.graphs


def _nodes(owner: GraphProto | FunctionProto) -> Iterator[NodeProto]:
    for node in owner.node:
        yield node
        for graph in _subgraphs(node):
            yield from _nodes(graph)


def _tensors(model: ModelProto) -> Iterator[TensorProto]:
    """Yield every tensor that the file holds, in subgraphs, functions and attributes too."""
    yield from _graph_tensors(model.graph)
    for function in model.functions:
        yield from _node_tensors(function)


def _graph_tensors(graph: GraphProto) -> Iterator[TensorProto]:
    yield from graph.initializer
    for sparse in graph.sparse_initializer:
        yield from (sparse.values, sparse.indices)
    yield from _node_tensors(graph)


def _node_tensors(owner: GraphProto | FunctionProto) -> Iterator[TensorProto]:
    for node in owner.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for sparse in (attribute.sparse_tensor, *attribute.sparse_tensors):
                yield from (sparse.values, sparse.indices)
        for graph in _subgraphs(node):
            yield from _graph_tensors(graph)


def _text(value: object) -> str:
    """Return a string of protobuf, which hands out bytes where it is not UTF-8."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _check_operation(path: Path, node: NodeProto, model: ModelProto) -> None:
    operation, domain = _text(node.op_type), _text(node.domain)
    if operation.endswith("_TRT") or domain in ("TRT", "trt.plugins"):
        raise InputError(
            f"{operation[:60]!r} is a plug-in of TensorRT, which onnxruntime does not have",
            where=path,
            remedy="Export the network without TensorRT's end-to-end suppression",
        )
    own = any((f.domain, f.name) == (node.domain, node.op_type) for f in model.functions)
    if domain not in _DOMAINS and not own:
        raise InputError(
            f"the operation {operation[:60]!r} of the domain {domain[:60]!r} is not part of ONNX",
            where=path,
            remedy="Export the network without custom operations",
        )


def _check_external(path: Path, tensor: TensorProto) -> None:
    entries = {_text(e.key): _text(e.value) for e in tensor.external_data}
    location = entries.get("location", "")
    shown = repr(location[:200])
    folder = path.parent.resolve()
    try:
        target = (folder / location).resolve()
        inside = target.is_relative_to(folder) and not Path(location).is_absolute()
        found = target.is_file()
    except (OSError, ValueError) as e:
        raise InputError(f"its external data {shown} are no file", where=path) from e
    if not inside:
        raise InputError(
            f"its external data {shown} lie outside of its folder",
            where=path,
            remedy="Such a file is refused, since it could read any file of this computer; keep "
            "the weights beside the network",
        )
    if not found:
        raise InputError(
            f"its external data {shown} are missing", where=path, remedy="Copy that file beside it"
        )
    needed = _bytes(entries.get("offset", "")) + _bytes(entries.get("length", ""))
    if (size := target.stat().st_size) < needed:
        raise InputError(
            f"its external data {shown} are cut off: {size} bytes, where {needed} are needed",
            where=path,
            remedy="Copy that file again",
        )


def _bytes(text: str) -> int:
    return int(text) if text.isdecimal() and len(text) < _MAX_DIGITS else 0
