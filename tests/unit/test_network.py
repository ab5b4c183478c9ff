"""Networks are opened safely: hostile files are refused in one line, devices are told honestly."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from onnx import TensorProto, helper, numpy_helper
from onnx.external_data_helper import set_external_data
from onnx_graphs import write_graph, yolo_graph

from percept.core.errors import DependencyError, InputError, PerceptError, UsageError
from percept.detection.networks.identify import identify
from percept.detection.networks.network import open_network

_TABLE = {"output0": np.ones((1, 8, 8))}


def _refusal(path: Path, **options: Any) -> str:
    with pytest.raises(InputError) as refused:
        open_network(path, **options)
    text = str(refused.value)
    assert text.startswith(str(path))
    assert text.isprintable(), "not one line"
    assert len(text) < 700
    return text


def _changed(path: Path, change: Callable[[onnx.ModelProto], object]) -> Path:
    model = onnx.load(path, load_external_data=False)
    change(model)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    return write_graph(tmp_path / "n.onnx", _TABLE, image=[1, 3, 64, 96])


def test_facts_of_a_network(graph: Path) -> None:
    network = open_network(graph)
    assert [str(s) for s in network.inputs] == ["images [1, 3, 64, 96]"]
    assert [str(s) for s in network.outputs] == ["output0 [1, 8, 8]"]
    assert network.image.dtype == "float32"
    assert not network.channels_last
    assert network.run(np.zeros((1, 3, 64, 96), np.uint8))[0].shape == (1, 8, 8)
    with pytest.raises(
        InputError, match=r"n.onnx: the network fails on an input of \[1, 3, 9, 9\]"
    ):
        network.run(np.zeros((1, 3, 9, 9), np.float32))


def test_metadata_and_dynamic_shapes(tmp_path: Path) -> None:
    path = write_graph(
        tmp_path / "n.onnx", _TABLE, image=["n", "h", "w", 3], metadata={"names": "['a']"}
    )
    network = open_network(path)
    assert network.image.shape == (None, None, None, 3)
    assert network.channels_last
    assert network.metadata == {"names": "['a']"}
    assert str(network.image) == "images [?, ?, ?, 3]"


def test_truncated_anywhere(tmp_path: Path) -> None:
    whole = yolo_graph(tmp_path / "whole.onnx", "v8", size=(64, 64)).read_bytes()
    cuts = {*np.linspace(0, len(whole) - 1, 60).astype(int), *range(len(whole) - 40, len(whole))}
    for cut in cuts:
        path = tmp_path / "cut.onnx"
        path.write_bytes(whole[:cut])
        assert "not a whole ONNX network" in (text := _refusal(path)) or "cannot open it" in text


def test_bytes_changed_anywhere_do_no_harm(tmp_path: Path) -> None:
    whole = yolo_graph(tmp_path / "whole.onnx", "v8", size=(64, 64), class_count=2).read_bytes()
    random = np.random.default_rng(0)
    refused = 0
    for _ in range(80):
        broken = bytearray(whole)
        broken[random.integers(len(whole))] ^= 1 << random.integers(8)
        path = tmp_path / "broken.onnx"
        path.write_bytes(broken)
        try:
            identify(open_network(path))
        except PerceptError:
            refused += 1
    assert refused > 5


@pytest.mark.parametrize(
    "content", [b"", b"\x89PNG\r\n\x1a\n" + bytes(100), b"PK\x03\x04", b"hello", bytes(10_000)]
)
def test_no_network_at_all(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "n.onnx"
    path.write_bytes(content)
    assert "not a whole ONNX network" in _refusal(path)


def test_a_folder(tmp_path: Path) -> None:
    assert "this is a folder" in _refusal(tmp_path)


def test_no_file(tmp_path: Path) -> None:
    assert "there is no such file" in _refusal(tmp_path / "missing.onnx")


@pytest.mark.parametrize("place", ["initializer", "constant", "subgraph", "function"])
@pytest.mark.parametrize(
    ("location", "says"),
    [
        ("../secret.bin", "outside of its folder"),
        ("/etc/passwd", "outside of its folder"),
        ("inner/../../secret.bin", "outside of its folder"),
        ("link.bin", "outside of its folder"),
        ("weights.bin", "are missing"),
        ("", "are missing"),
        ("nul\x00l", "are no file"),
    ],
)
def test_external_data_elsewhere(place: str, location: str, says: str, tmp_path: Path) -> None:
    folder = tmp_path / "models"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(400))
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    path = write_graph(folder / "n.onnx", _TABLE, image=[1, 3, 64, 96])
    assert says in _refusal(_changed(path, lambda m: _add_external(m, place, location)))


def test_external_data_by_an_absolute_path(graph: Path) -> None:
    inside = graph.with_name("weights.bin")
    inside.write_bytes(bytes(400))
    changed = _changed(graph, lambda m: _add_external(m, "initializer", str(inside)))
    assert "outside of its folder" in _refusal(changed)


def _add_external(model: onnx.ModelProto, place: str, location: str) -> None:
    tensor = numpy_helper.from_array(np.zeros(100, np.float32), "weights")
    set_external_data(tensor, location or "empty")
    tensor.external_data[0].value = location
    tensor.ClearField("raw_data")
    node = helper.make_node("Constant", [], ["unused"], value=tensor)
    inner = helper.make_graph([node], "inner", [], [])
    if place == "initializer":
        model.graph.initializer.append(tensor)
    elif place == "constant":
        model.graph.node.append(node)
    elif place == "subgraph":
        model.graph.node.append(helper.make_node("If", ["x"], ["y"], then_branch=inner))
    else:
        opset = helper.make_opsetid("", 17)
        model.functions.append(helper.make_function("own", "f", [], ["unused"], [node], [opset]))


def test_external_data_beside_the_network_are_read(tmp_path: Path) -> None:
    path = yolo_graph(tmp_path / "n.onnx", "v8", size=(320, 192))
    onnx.save(onnx.load(path), tmp_path / "e.onnx", save_as_external_data=True, location="e.bin")
    assert (tmp_path / "e.bin").stat().st_size > 100_000
    assert identify(open_network(tmp_path / "e.onnx")).name == "v8"
    (tmp_path / "e.bin").write_bytes(bytes(10))
    assert "cut off: 10 bytes, where 423360 are needed" in _refusal(tmp_path / "e.onnx")


@pytest.mark.parametrize(
    ("operation", "domain", "says"),
    [
        ("EfficientNMS_TRT", "TRT", "'EfficientNMS_TRT' is a plug-in of TensorRT"),
        ("BatchedNMSDynamic_TRT", "", "'BatchedNMSDynamic_TRT' is a plug-in of TensorRT"),
        ("NMSRotated", "mmdeploy", "'NMSRotated' of the domain 'mmdeploy' is not part of ONNX"),
    ],
)
@pytest.mark.parametrize("nested", ["", "nested"])
def test_operations_that_are_not_onnx(
    operation: str, domain: str, says: str, nested: str, graph: Path
) -> None:
    node = helper.make_node(operation, ["images"], ["y"], domain=domain)
    inner = helper.make_graph([node], "inner", [], [])
    outer = helper.make_node("If", ["x"], ["y"], then_branch=inner) if nested else node
    assert says in _refusal(_changed(graph, lambda m: m.graph.node.append(outer)))


def test_operations_of_the_files_own_functions(graph: Path) -> None:
    def add(model: onnx.ModelProto) -> None:
        body = [helper.make_node("Identity", ["a"], ["b"])]
        opset = helper.make_opsetid("", 17)
        model.functions.append(helper.make_function("own", "Same", ["a"], ["b"], body, [opset]))
        model.opset_import.append(helper.make_opsetid("own", 1))
        last = model.graph.node[-1]
        model.graph.node.append(
            helper.make_node("Same", ["before"], [last.output[0]], domain="own")
        )
        last.output[0] = "before"

    assert open_network(_changed(graph, add)).run(np.zeros((1, 3, 64, 96)))[0].shape == (1, 8, 8)


@pytest.mark.parametrize(("opset", "ir_version"), [(99, 8), (17, 99)])
def test_too_new(opset: int, ir_version: int, graph: Path) -> None:
    def age(model: onnx.ModelProto) -> None:
        model.opset_import[0].version, model.ir_version = opset, ir_version

    text = _refusal(_changed(graph, age))
    assert f"(ir {ir_version}, opset {opset})" in text
    assert "onnxruntime_src" not in text


def _input(shape: list[int | str], kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info("other", kind, shape)


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        ([1, 10], TensorProto.FLOAT),
        ([1, 1, 64, 64], TensorProto.FLOAT),
        ([1, 6, 64, 64], TensorProto.FLOAT),
        ([1, 3, 64, 64], TensorProto.INT64),
        ([1, 3, 90_000, 90_000], TensorProto.FLOAT),
        ([1, 3, 16, 16], TensorProto.FLOAT),
        ([100_000, 3, 64, 64], TensorProto.FLOAT),
        ([0, 3, 64, 64], TensorProto.FLOAT),
        ([1, 3, 16, 64, 64], TensorProto.FLOAT),
        (["n"], TensorProto.STRING),
    ],
)
def test_no_image_goes_in(shape: list[int | str], kind: int, tmp_path: Path) -> None:
    info = helper.make_tensor_value_info("x", kind, shape)
    out = helper.make_tensor_value_info("y", kind, shape)
    node = helper.make_node("Identity", ["x"], ["y"])
    model = helper.make_model(
        helper.make_graph([node], "g", [info], [out]), opset_imports=[helper.make_opsetid("", 17)]
    )
    model.ir_version = 8
    path = tmp_path / "n.onnx"
    path.write_bytes(model.SerializeToString())
    assert "its inputs are x [" in _refusal(path)


def test_further_inputs_that_nobody_can_fill(graph: Path) -> None:
    text = _refusal(_changed(graph, lambda m: m.graph.input.append(_input([1, 77]))))
    assert "images [1, 3, 64, 96]; other [1, 77]" in text


def test_an_output_that_is_no_tensor(graph: Path) -> None:
    def add(model: onnx.ModelProto) -> None:
        model.graph.node.append(helper.make_node("SequenceConstruct", ["output0"], ["list"]))
        kind = helper.make_sequence_type_proto(helper.make_tensor_type_proto(1, [1, 8, 8]))
        model.graph.output.append(helper.make_value_info("list", kind))

    with pytest.raises(InputError, match=r"its output list \[\] is seq\(tensor\(float\)\)"):
        identify(open_network(_changed(graph, add)))


def test_the_device_is_told(graph: Path) -> None:
    assert open_network(graph, device="cpu").device == "cpu"
    auto = open_network(graph)
    assert auto.device == "cpu"
    assert "no provider for a GPU or OpenVINO is installed" in auto.device_note
    assert auto.session.get_providers() == ["CPUExecutionProvider"]


def test_a_device_that_is_not_there(graph: Path) -> None:
    with pytest.raises(DependencyError, match="pip install onnxruntime-gpu"):
        open_network(graph, device="cuda")
    with pytest.raises(DependencyError, match="pip install onnxruntime-openvino"):
        open_network(graph, device="openvino")
    with pytest.raises(UsageError, match="no device 'tpu'"):
        open_network(graph, device="tpu")  # type: ignore[arg-type] # what a user may type


def test_a_provider_that_does_not_start(graph: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # onnxruntime falls back to the processor without a word.
    listed = ["CUDAExecutionProvider", "AzureExecutionProvider", "CPUExecutionProvider"]
    open_session = ort.InferenceSession
    asked: list[list[str]] = []

    def fall_back(
        path: str, options: object, providers: list[str], **_: object
    ) -> ort.InferenceSession:
        asked.append(providers)
        return open_session(path, options, providers=["CPUExecutionProvider"])

    monkeypatch.setattr(ort, "get_available_providers", lambda: listed)
    monkeypatch.setattr(ort, "InferenceSession", fall_back)
    network = open_network(graph)
    assert asked == [["CUDAExecutionProvider", "CPUExecutionProvider"]]
    assert network.device == "cpu"
    assert "CUDAExecutionProvider is installed but does not start" in network.device_note
    with pytest.raises(DependencyError, match="does not start"):
        open_network(graph, device="cuda")


def test_many_threads_may_run_it(tmp_path: Path) -> None:
    path = yolo_graph(tmp_path / "n.onnx", "v8", size=(320, 192), fires="0..255")
    network = open_network(path)
    pictures = [np.full((1, 3, 192, 320), 255 * (k % 2), np.float32) for k in range(40)]
    alone = [network.run(p)[0] for p in pictures]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(lambda p: network.run(p)[0], pictures))
    np.testing.assert_array_equal(together, alone)
    assert not np.array_equal(alone[0], alone[1])
