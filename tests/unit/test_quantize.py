"""Networks in 8-bit integers: which layers stay as they are, and how two networks are compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from lamp_network import lamp_network, lamp_picture
from onnx import TensorProto, helper, numpy_helper
from onnx_graphs import write_graph

from percept.core.errors import InputError, InsufficientDataError
from percept.core.results import Detections2D, Verdict
from percept.detection import YoloDetector
from percept.detection.agreement import Agreement, compare_detectors, judge_agreement
from percept.detection.networks.network import open_network
from percept.detection.quantize import layers_to_keep, quantize_network


def _graph(*nodes: onnx.NodeProto, weights: dict[str, tuple[int, ...]]) -> onnx.GraphProto:
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, 64, 64])
    tensors = [numpy_helper.from_array(np.zeros(s, np.float32), n) for n, s in weights.items()]
    return helper.make_graph(list(nodes), "graph", [image], [], tensors)


def _conv(name: str, source: str, groups: int = 1, weight: str = "w") -> onnx.NodeProto:
    return helper.make_node("Conv", [source, weight], [name], name=name, group=groups)


class TestLayersToKeep:
    def test_first_depthwise_last_and_decoding_layers(self) -> None:
        # image -> first -> middle -> depthwise -> box -> DFL -> output
        #          image's shape -> Reshape           -> score -> output
        graph = _graph(
            helper.make_node("Shape", ["image"], ["shape"]),
            helper.make_node("MaxPool", ["image"], ["pooled"]),
            _conv("first", "pooled"),
            helper.make_node("Mul", ["first", "first"], ["activated"]),
            _conv("middle", "activated"),
            _conv("depthwise", "middle", groups=8, weight="w_depthwise"),
            _conv("grouped", "depthwise", groups=2),
            _conv("of_one_channel", "grouped", weight="w_depthwise"),
            helper.make_node("Reshape", ["of_one_channel", "shape"], ["shaped"]),
            _conv("behind_a_shape", "shaped"),
            _conv("box", "behind_a_shape"),
            _conv("score", "behind_a_shape"),
            helper.make_node("Transpose", ["box"], ["turned"]),
            helper.make_node("Softmax", ["turned"], ["likely"]),
            helper.make_node("Reshape", ["likely", "shape"], ["rows"]),
            _conv("dfl", "rows"),
            weights={"w": (8, 4, 3, 3), "w_depthwise": (8, 1, 3, 3)},
        )
        assert layers_to_keep(graph) == {
            "depthwise": "depthwise",
            "first": "sees pixels",
            "box": "puts out boxes or scores",
            "score": "puts out boxes or scores",
            "dfl": "puts out boxes or scores",
        }

    def test_attention_is_no_decoding(self) -> None:
        graph = _graph(
            _conv("first", "image"),
            helper.make_node("Softmax", ["first"], ["weights"]),
            helper.make_node("MatMul", ["weights", "first"], ["mixed"]),
            _conv("projection", "mixed"),
            _conv("last", "projection"),
            weights={"w": (8, 8, 1, 1)},
        )
        assert set(layers_to_keep(graph)) == {"first", "last"}


@pytest.fixture(scope="module")
def lamps(tmp_path_factory: pytest.TempPathFactory) -> YoloDetector:
    return YoloDetector(lamp_network(tmp_path_factory.mktemp("lamps") / "lamps.onnx"))


class TestQuantizeNetwork:
    @pytest.mark.parametrize("opset", [11, 17])
    def test_the_network_stays_the_same_in_all_but_numbers(
        self, tmp_path: Path, opset: int
    ) -> None:
        facts = {"names": "{0: 'lamp'}", "task": "detect", "author": "me"}
        source = lamp_network(tmp_path / "lamps.onnx", opset=opset, metadata=facts)
        before = source.read_bytes()
        detector = YoloDetector(source)
        tensors = (detector.prepare(lamp_picture(seed))[0] for seed in range(8))
        layers = quantize_network(detector.network, tmp_path / "int8.onnx", tensors)
        assert (layers.quantized, layers.images) == (3, 8)
        assert layers.kept == {"sees pixels": 1, "puts out boxes or scores": 3}
        other = YoloDetector(tmp_path / "int8.onnx")
        assert other.layout == detector.layout
        assert other.network.metadata == facts
        assert (other.network.inputs, other.network.outputs) == (
            detector.network.inputs,
            detector.network.outputs,
        )
        nodes = onnx.load(str(tmp_path / "int8.onnx")).graph.node
        assert sum(node.op_type == "QuantizeLinear" for node in nodes) >= 3
        assert source.read_bytes() == before
        found = compare_detectors(detector, other, [lamp_picture(seed) for seed in range(20, 30)])
        assert found.images == 10
        assert found.boxes > 40
        assert found.share_75 == 1.0
        assert 0 < max(map(abs, found.shifts)) < 0.05

    def test_the_silu_behind_a_quantised_layer_works_on_integers_too(self, tmp_path: Path) -> None:
        # image -> first -> SiLU -> middle -> SiLU -> last -> sigmoid of one times another
        graph = _graph(
            _conv("first", "image"),
            helper.make_node("Sigmoid", ["first"], ["first_gate"]),
            helper.make_node("Mul", ["first", "first_gate"], ["x1"]),
            _conv("middle", "x1", weight="w_inner"),
            helper.make_node("Sigmoid", ["middle"], ["middle_gate"]),
            helper.make_node("Mul", ["middle_gate", "middle"], ["x2"]),
            _conv("last", "x2", weight="w_inner"),
            helper.make_node("Mul", ["middle_gate", "last"], ["output"]),
            weights={"w": (8, 3, 3, 3), "w_inner": (8, 8, 1, 1)},
        )
        graph.output.append(
            helper.make_tensor_value_info("output", TensorProto.FLOAT, [1, 8, 62, 62])
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        onnx.save(model, str(tmp_path / "silu.onnx"))
        picture = np.random.default_rng(0).random((1, 3, 64, 64), np.float32)
        network = open_network(tmp_path / "silu.onnx")
        assert quantize_network(network, tmp_path / "int8.onnx", [picture]).quantized == 1
        nodes = onnx.load(str(tmp_path / "int8.onnx")).graph.node
        wide = {name for n in nodes if n.op_type == "DequantizeLinear" for name in n.output}
        makers = {name: node for node in nodes for name in node.output}
        from_integers = {
            name: [source in wide for source in makers[name].input]
            for name in ("first_gate", "x1", "middle_gate", "x2")
        }
        assert from_integers == {
            "first_gate": [False],
            "x1": [False, False],
            "middle_gate": [True],
            "x2": [True, True],
        }

    def test_one_that_is_quantised_already_is_refused(
        self, lamps: YoloDetector, tmp_path: Path
    ) -> None:
        tensor = lamps.prepare(lamp_picture(1))[0]
        quantize_network(lamps.network, tmp_path / "int8.onnx", [tensor])
        network = open_network(tmp_path / "int8.onnx")
        with pytest.raises(InputError, match="it is quantised already"):
            quantize_network(network, tmp_path / "again.onnx", [tensor])

    def test_half_precision_is_refused(self, tmp_path: Path) -> None:
        network = open_network(lamp_network(tmp_path / "half.onnx", half=True))
        with pytest.raises(InputError, match=r"half\.onnx: it is not in float32"):
            quantize_network(network, tmp_path / "int8.onnx", [])

    def test_one_without_convolutions_is_refused(self, tmp_path: Path) -> None:
        path = write_graph(tmp_path / "tiny.onnx", {"output0": np.zeros((1, 84, 8400), np.float32)})
        tensor = np.zeros((1, 3, 640, 640), np.float32)
        with pytest.raises(InputError, match="no layer of it can be quantised"):
            quantize_network(open_network(path), tmp_path / "int8.onnx", [tensor])

    def test_a_second_input_is_refused(self, tmp_path: Path) -> None:
        outputs = {"output0": np.zeros((1, 84, 8400), np.float32)}
        path = write_graph(tmp_path / "two.onnx", outputs, image_shape_input=True)
        with pytest.raises(InputError, match=r"inputs besides the image: .*image_shape"):
            quantize_network(open_network(path), tmp_path / "int8.onnx", [])

    def test_without_images_nothing_is_written(self, lamps: YoloDetector, tmp_path: Path) -> None:
        with pytest.raises(InsufficientDataError, match="no images"):
            quantize_network(lamps.network, tmp_path / "int8.onnx", [])
        assert not list(tmp_path.iterdir())


class _Says:
    """A detector that finds what it is told, whatever it sees."""

    def __init__(self, boxes: list[list[float]], labels: str, scores: list[float]) -> None:
        self.network = self
        table = np.array(boxes, np.float64).reshape(-1, 4)
        self.found = Detections2D(0, "", table, tuple(labels), np.array(scores, np.float64))

    def prepare(self, image: object) -> tuple[object, None]:
        return image, None

    def run(self, tensor: object) -> None:
        pass

    def detect_one(self, _: object) -> tuple[Detections2D, dict[str, float]]:
        return self.found, {}


def _compared(first: _Says, other: _Says, images: int = 1) -> Agreement:
    return compare_detectors(first, other, [np.zeros((1, 1, 3), np.uint8)] * images)  # type: ignore[arg-type]


class TestAgreement:
    def test_hand_worked_pairs(self) -> None:
        first = _Says(
            [[0, 0, 10, 10], [100, 0, 110, 10], [200, 0, 210, 10], [300, 0, 310, 10]],
            "aaab",
            [0.9, 0.8, 0.7, 0.6],
        )
        other = _Says(
            [
                [0, 0, 10, 8],  # IoU 0.8 with the first
                [100, 0, 110, 6],  # 0.6 with the second
                [200, 0, 210, 4],  # 0.4 with the third: not the same
                [300, 0, 310, 10],  # the fourth, but of another class
                [0, 0, 10, 7],  # 0.7 with the first, which has its pair
            ],
            "aaaaa",
            [0.85, 0.9, 0.5, 0.5, 0.5],
        )
        found = _compared(first, other)
        assert (found.boxes, found.boxes_other) == (4, 5)
        assert (found.matched_50, found.matched_75) == (2, 1)
        assert found.share_50 == pytest.approx(4 / 9)
        assert found.share_75 == pytest.approx(2 / 9)
        assert found.shifts == pytest.approx([-0.05, 0.1])
        assert found.mean_shift == pytest.approx(0.025)

    def test_a_box_has_one_partner(self) -> None:
        first = _Says([[0, 0, 10, 9], [0, 0, 10, 10]], "aa", [0.5, 0.9])
        found = _compared(first, _Says([[0, 0, 10, 10]], "a", [0.8]))
        assert found.matched_50 == 1
        assert found.shifts == pytest.approx([-0.1])

    @pytest.mark.parametrize("empty_first", [True, False])
    def test_one_that_finds_nothing(self, *, empty_first: bool) -> None:
        some, none = _Says([[0, 0, 1, 1]], "a", [0.5]), _Says([], "", [])
        found = _compared(none, some) if empty_first else _compared(some, none)
        assert (found.matched_50, found.share_50) == (0, 0.0)

    def test_two_that_find_nothing_agree(self) -> None:
        found = _compared(_Says([], "", []), _Says([], "", []), images=3)
        assert (found.images, found.share_50) == (3, 1.0)

    def test_the_speed_is_the_median_of_ratios(self) -> None:
        found = Agreement(ms=[10, 10, 90], ms_other=[5, 4, 90])
        assert found.speed == 2.0


def _judged(matched: int, matched_75: int, shift: float, speed: float = 2.0) -> Agreement:
    return Agreement(
        images=10,
        boxes=100,
        boxes_other=100,
        matched_50=matched,
        matched_75=matched_75,
        shifts=[shift] * matched,
        ms=[speed],
        ms_other=[1.0],
    )


class TestVerdict:
    @pytest.mark.parametrize(
        ("found", "verdict", "why"),
        [
            (_judged(97, 93, 0.01), Verdict.GOOD, ()),
            (_judged(90, 85, 0.01), Verdict.DOUBTFUL, ("90% of the boxes agree at IoU 0.5",)),
            (_judged(97, 80, 0.01), Verdict.DOUBTFUL, ("80% at 0.75",)),
            (_judged(97, 93, -0.05), Verdict.DOUBTFUL, ("confidences are -0.050 off",)),
            (_judged(97, 93, 0.0, speed=0.7), Verdict.DOUBTFUL, ("0.70 times as fast",)),
            (_judged(79, 70, 0.0), Verdict.BAD, ("only 79% of the boxes agree",)),
            (_judged(97, 93, 0.15), Verdict.BAD, ("confidences are +0.150 off",)),
            (_judged(20, 20, 0.0, speed=0.5), Verdict.BAD, ("only 20%", "0.50 times as fast")),
        ],
    )
    def test_limits(self, found: Agreement, verdict: Verdict, why: tuple[str, ...]) -> None:
        judged, reasons = judge_agreement(found)
        assert judged == verdict
        assert len(reasons) == len(why)
        assert all(part in reason for part, reason in zip(why, reasons, strict=True))

    def test_few_boxes_prove_little(self) -> None:
        found = Agreement(
            boxes=10, boxes_other=10, matched_50=10, matched_75=10, ms=[2], ms_other=[1]
        )
        assert judge_agreement(found) == (Verdict.DOUBTFUL, ("only 10 boxes to compare",))
