"""Networks on the images of a log: against the best that this machine can do, and a plain script.

    python tests/benchmarks/bench_detect.py --data ../shared/data

For each network these ways in turns, so that a busy machine slows all alike; ratios are what
counts, the median over the rounds. Opening a log and the first image of a pool are part of it:

- percept: from the log to boxes, as `percept detect` works: messages, JPEG, letterbox, network,
  decoding, suppression, results in order.
- ceiling: letterbox and `session.run` alone on images that are decoded already, in the faster of
  two layouts: as many workers as cores with one thread each, or one run with a thread a core.
- decoding: the same workers, which decode the JPEG files too: what every program has to do.
- plain: a loop over the log with rosbags, `cv2.imdecode`, letterbox, `session.run` of
  onnxruntime's defaults, and suppression in numpy.
"""

from __future__ import annotations

import argparse
import itertools
import platform
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import onnxruntime as ort
import simplejpeg
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from rosbags.highlevel import AnyReader

from percept.core.samples import CameraImage
from percept.datasets import open_recording
from percept.datasets.recording import UndecodedMessage
from percept.datasets.write import LogWriter
from percept.detection import YoloDetector
from percept.detection.cores import available_cores
from percept.detection.models import builtin_model
from percept.detection.networks.layout import Layout
from percept.detection.runner import ImageJob, detect_on_image, ordered_map

_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
_PICTURES = ("lane/carnd_p1/*.jpg", "scenes/kitti_*/**/*.png", "scenes/sustechpoints/**/*.jpg")
_TOPIC = "/camera/image/compressed"

STRIDES = (8, 16, 32)

Image = NDArray[np.uint8]


def main() -> None:
    """Run all networks and print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=_DATA)
    parser.add_argument("--model", type=Path, help="only this one, on images of --size")
    parser.add_argument("--size", default="1280x720", help="WxH")
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    print_machine()
    with tempfile.TemporaryDirectory() as folder:
        cases = find_cases(arguments.data, Path(folder))
        for path, size in [(arguments.model, arguments.size)] if arguments.model else cases:
            width, height = (int(side) for side in size.split("x"))
            images = read_pictures(arguments.data, (width, height))
            log = Path(folder) / f"{size}.mcap"
            if not log.exists():
                write_log(log, images, arguments.images)
            print(f"\n{path.name}, {arguments.images} JPEG images of {size}", flush=True)
            measure(path, log, images, arguments)


def print_machine() -> None:
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    versions = f"onnxruntime {ort.__version__}, OpenCV {cv2.__version__}"
    print(f"{cpu}, {available_cores()} cores; Python {platform.python_version()}, {versions}")


def find_cases(data: Path, folder: Path) -> Iterator[tuple[Path, str]]:
    """Yield networks and sizes of images: the one that ships, YOLOX nano, and YOLOv8n's layers."""
    nano = data / "yolo/yolox_nano/yolox_nano.onnx"
    yield builtin_model(), "640x400"
    yield nano, "1280x720"
    yield nano, "1242x376"
    yield write_yolov8n(folder / "yolov8n_random.onnx"), "1280x720"


# ---- the ways


def measure(path: Path, log: Path, images: Sequence[Image], arguments: argparse.Namespace) -> None:
    detector = YoloDetector(path)
    decoded = list(itertools.islice(itertools.cycle(images), arguments.images))
    files = [cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1] for image in decoded]
    ways: dict[str, Callable[[], object]] = {
        "percept": lambda: sum(1 for _ in percept_results(detector, log)),
        "workers": partial(pool_of_workers, detector, decoded),
        "threads": ceiling_of_threads(path, detector, decoded),
        "decoding": partial(pool_of_workers, detector, files),
        "plain": partial(plain_script, path, log, detector),
    }
    times: dict[str, list[float]] = {name: [] for name in ways}
    cpu: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(arguments.rounds + 1):
        for name, way in ways.items():
            start, cpu_start = time.perf_counter(), time.process_time()
            way()
            times[name].append(1e3 * (time.perf_counter() - start) / len(decoded))
            cpu[name].append(1e3 * (time.process_time() - cpu_start) / len(decoded))
    # The first round is for what is made once.
    print_ways({n: t[1:] for n, t in times.items()}, {n: t[1:] for n, t in cpu.items()})


def print_ways(times: dict[str, list[float]], cpu: dict[str, list[float]]) -> None:
    best = min(("workers", "threads"), key=lambda name: statistics.median(times[name]))
    print(f"  the ceiling is that of {best}")
    for name, values in times.items():
        wall = statistics.median(values)
        print(
            f"  {name:<9}{wall:7.1f} ms an image, {1e3 / wall:6.1f} images/s, "
            f"{statistics.median(cpu[name]):6.1f} ms of all cores together"
        )
    for name, label in (
        (best, "of the ceiling"),
        ("decoding", "of the workers that decode JPEG too"),
        ("plain", "times the plain script"),
    ):
        ratios = [a / b for a, b in zip(times[name], times["percept"], strict=True)]
        print(f"  percept  {statistics.median(ratios):6.2f} {label}")


def percept_results(detector: YoloDetector, log: Path) -> Iterator[int]:
    detectors = {"model": detector}
    with open_recording(log) as recording:
        jobs = (
            ImageJob(
                frame=frame,
                camera="camera",
                stamp_ns=message.stamp_ns,
                log_time_ns=message.log_time_ns,
                models=("model",),
                load=partial(image_of, message),
            )
            for frame, message in enumerate(recording.undecoded(topics=_TOPIC))
        )
        work = partial(detect_on_image, detectors=detectors)
        for result in ordered_map(work, jobs, workers=available_cores()):
            yield len(result.boxes["model"])


def image_of(message: UndecodedMessage) -> CameraImage:
    (image,) = message.decode()
    assert isinstance(image, CameraImage)
    return image


def pool_of_workers(detector: YoloDetector, images: Sequence[Image]) -> None:
    """Letterbox and run images, or JPEG files (N,), with a worker a core on one session."""

    def look(image: Image) -> None:
        pixels: Any = simplejpeg.decode_jpeg(image, "BGR") if image.ndim == 1 else image
        detector.network.run(detector.prepare(pixels)[0])

    with ThreadPoolExecutor(available_cores()) as pool:
        for _ in pool.map(look, images):
            pass


def ceiling_of_threads(
    path: Path, detector: YoloDetector, images: Sequence[Image]
) -> Callable[[], object]:
    """Return a run of one image after the other, each with a thread for each core."""
    options = ort.SessionOptions()
    options.intra_op_num_threads = available_cores()
    session = ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name

    def run() -> None:
        for image in images:
            session.run(None, {name: detector.prepare(image)[0]})

    return run


def plain_script(path: Path, log: Path, detector: YoloDetector) -> int:
    """Do what a script of thirty lines does; it is told how the network is read."""
    session = ort.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    name = session.get_inputs()[0].name
    found = 0
    with AnyReader([log]) as reader:
        connections = [c for c in reader.connections if c.topic == _TOPIC]
        for connection, _, raw in reader.messages(connections):
            message: Any = reader.deserialize(raw, connection.msgtype)
            image: Any = cv2.imdecode(message.data, cv2.IMREAD_COLOR)
            outputs = session.run(None, {name: plain_tensor(image, detector.layout)})
            found += len(boxes_of(outputs[0][0], detector.layout.name))
    return found


def plain_tensor(image: Image, layout: Layout) -> NDArray[np.float32]:
    width, height = layout.input_size
    ratio = min(width / image.shape[1], height / image.shape[0])
    small = cv2.resize(image, (int(image.shape[1] * ratio), int(image.shape[0] * ratio)))
    grey = np.full((height, width, 3), 114, np.uint8)
    grey[: small.shape[0], : small.shape[1]] = small
    swap = layout.pixels.order == "rgb"
    blob = cv2.dnn.blobFromImage(grey, layout.pixels.scale, swapRB=swap)
    return np.asarray(blob, np.float32)


def boxes_of(table: NDArray[np.float32], layout: str) -> NDArray[np.float32]:
    """Return (N, 5) boxes and scores after suppression, as the demo scripts do it in numpy."""
    if layout == "v8":
        table = table.T
        scores, boxes = table[:, 4:], table[:, :4]
    else:
        scores, boxes = table[:, 4:5] * table[:, 5:], table[:, :4]
    best = scores.max(axis=1)
    wanted = best > 0.25
    boxes, best = boxes[wanted], best[wanted]
    corners = np.concatenate([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2], 1)
    order, kept = best.argsort()[::-1], []
    while order.size:
        i, order = order[0], order[1:]
        kept.append(i)
        low = np.maximum(corners[i, :2], corners[order, :2])
        high = np.minimum(corners[i, 2:], corners[order, 2:])
        shared = np.clip(high - low, 0, None).prod(axis=1)
        areas = (corners[:, 2:] - corners[:, :2]).prod(axis=1)
        order = order[shared / (areas[i] + areas[order] - shared) <= 0.45]
    return np.column_stack([corners[kept], best[kept]])


# ---- data


def read_pictures(data: Path, size: tuple[int, int]) -> list[Image]:
    """Return road pictures in one size, the middle cut to its shape."""
    paths = sorted(path for pattern in _PICTURES for path in data.glob(pattern))
    pictures = []
    for path in paths:
        image: Any = cv2.imread(str(path))
        height, width = image.shape[:2]
        scale = max(size[0] / width, size[1] / height)
        grown: Any = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        left, top = (grown.shape[1] - size[0]) // 2, (grown.shape[0] - size[1]) // 2
        pictures.append(np.ascontiguousarray(grown[top : top + size[1], left : left + size[0]]))
    return pictures


def write_log(path: Path, images: Sequence[Image], count: int) -> None:
    with LogWriter(path, "mcap", images="jpeg") as log:
        for number, image in enumerate(itertools.islice(itertools.cycle(images), count)):
            time_ns = 1_700_000_000_000_000_000 + number * 50_000_000
            log.write(
                CameraImage(
                    topic=_TOPIC, stamp_ns=time_ns, log_time_ns=time_ns, frame="cam", pixels=image
                )
            )


# ---- a network of the size of YOLOv8n


@dataclass
class GraphMaker:
    """Nodes of a network with random weights."""

    nodes: list[onnx.NodeProto]
    weights: list[onnx.TensorProto]
    random: np.random.Generator

    def add(self, op: str, *inputs: str, **attributes: Any) -> str:
        name = f"t{len(self.nodes)}"
        self.nodes.append(helper.make_node(op, list(inputs), [name], **attributes))
        return name

    def constant(self, array: NDArray[Any]) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(array, name))
        return name

    def convolution(
        self,
        x: str,
        channels: tuple[int, int],
        size: int = 3,
        stride: int = 1,
        *,
        last: float = 0.0,
    ) -> str:
        """Add a convolution and its SiLU; with `last`, which is its bias, none."""
        source, target = channels
        # So that activations keep their size, and that few boxes come out of noise.
        spread = (0.03 if last else 1.0) * 1.6 / (size * source**0.5)
        weight = self.random.normal(0, spread, (target, source, size, size))
        inputs = [x, self.constant(weight.astype(np.float32))]
        inputs.append(self.constant(np.full(target, last, np.float32)))
        pads = [size // 2] * 4
        y = self.add("Conv", *inputs, kernel_shape=[size, size], strides=[stride] * 2, pads=pads)
        return y if last else self.add("Mul", y, self.add("Sigmoid", y))

    def c2f(self, x: str, channels: tuple[int, int], repeats: int, *, add: bool = True) -> str:
        half = channels[1] // 2
        parts = [self.convolution(x, (channels[0], half), 1) for _ in range(2)]
        for _ in range(repeats):
            y = self.convolution(self.convolution(parts[-1], (half, half)), (half, half))
            parts.append(self.add("Add", parts[-1], y) if add else y)
        joined = self.add("Concat", *parts, axis=1)
        return self.convolution(joined, (half * len(parts), channels[1]), 1)

    def pooled(self, x: str) -> str:
        pools = [self.convolution(x, (256, 128), 1)]
        for _ in range(3):
            pools.append(
                self.add("MaxPool", pools[-1], kernel_shape=[5, 5], pads=[2] * 4, strides=[1, 1])
            )
        return self.convolution(self.add("Concat", *pools, axis=1), (512, 256), 1)

    def doubled(self, x: str) -> str:
        scales = self.constant(np.array([1, 1, 2, 2], np.float32))
        return self.add("Resize", x, "", scales, mode="nearest")

    def head(self, x: str, channels: int, cells: int) -> tuple[str, str]:
        """Add the branches of one scale: distances (1, 64, cells), classes (1, 80, cells)."""
        box = self.convolution(self.convolution(x, (channels, 64)), (64, 64))
        box = self.convolution(box, (64, 64), 1, last=0.1)
        classes = self.convolution(self.convolution(x, (channels, 80)), (80, 80))
        classes = self.convolution(classes, (80, 80), 1, last=-5.0)
        shapes = [self.constant(np.array([1, n, cells])) for n in (64, 80)]
        return self.add("Reshape", box, shapes[0]), self.add("Reshape", classes, shapes[1])


def write_yolov8n(path: Path, size: tuple[int, int] = (640, 384)) -> Path:
    """Write a network with the layers of YOLOv8n and random weights, for images of 16 to 9."""
    g = GraphMaker([], [], np.random.default_rng(0))
    x = g.convolution(g.convolution("images", (3, 16), 3, 2), (16, 32), 3, 2)
    x = g.convolution(g.c2f(x, (32, 32), 1), (32, 64), 3, 2)
    p3 = g.c2f(x, (64, 64), 2)
    p4 = g.c2f(g.convolution(p3, (64, 128), 3, 2), (128, 128), 2)
    p5 = g.pooled(g.c2f(g.convolution(p4, (128, 256), 3, 2), (256, 256), 1))
    n4 = g.c2f(g.add("Concat", g.doubled(p5), p4, axis=1), (384, 128), 1, add=False)
    n3 = g.c2f(g.add("Concat", g.doubled(n4), p3, axis=1), (192, 64), 1, add=False)
    joined = g.add("Concat", g.convolution(n3, (64, 64), 3, 2), n4, axis=1)
    m4 = g.c2f(joined, (192, 128), 1, add=False)
    joined = g.add("Concat", g.convolution(m4, (128, 128), 3, 2), p5, axis=1)
    m5 = g.c2f(joined, (384, 256), 1, add=False)
    cells = [size[0] // s * (size[1] // s) for s in STRIDES]
    parts = [g.head(*scale) for scale in zip((n3, m4, m5), (64, 128, 256), cells, strict=True)]
    boxes, classes = (g.add("Concat", *branch, axis=2) for branch in zip(*parts, strict=True))
    output = g.add("Concat", decoded(g, boxes, size), g.add("Sigmoid", classes), axis=1)
    graph = helper.make_graph(
        g.nodes,
        "yolov8n",
        [helper.make_tensor_value_info("images", 1, [1, 3, size[1], size[0]])],
        [helper.make_tensor_value_info(output, 1, [1, 84, sum(cells)])],
        g.weights,
    )
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=8), str(path))
    return path


def decoded(g: GraphMaker, boxes: str, size: tuple[int, int]) -> str:
    """Turn distributions (1, 64, N) over distances into boxes (1, 4, N): x, y, w, h in pixels."""
    parts = g.add("Reshape", boxes, g.constant(np.array([1, 4, 16, -1])))
    parts = g.add("Softmax", g.add("Transpose", parts, perm=[0, 2, 1, 3]), axis=1)
    steps = g.constant(np.arange(16, dtype=np.float32).reshape(1, 16, 1, 1))
    sides = g.add("Reshape", g.add("Conv", parts, steps), g.constant(np.array([1, 4, -1])))
    halves = [np.array([0]), np.array([2]), np.array([4]), np.array([1])]
    start, middle, end, axis = (g.constant(half) for half in halves)
    grids = [np.mgrid[: size[1] // s, : size[0] // s].reshape(2, -1)[::-1] + 0.5 for s in STRIDES]
    anchors = g.constant(np.concatenate(grids, axis=1)[None].astype(np.float32))
    first = g.add("Sub", anchors, g.add("Slice", sides, start, middle, axis))
    last = g.add("Add", anchors, g.add("Slice", sides, middle, end, axis))
    centres = g.add("Mul", g.add("Add", first, last), g.constant(np.array(0.5, np.float32)))
    joined = g.add("Concat", centres, g.add("Sub", last, first), axis=1)
    lengths = np.concatenate([np.full(a.shape[1], s) for a, s in zip(grids, STRIDES, strict=True)])
    return g.add("Mul", joined, g.constant(lengths[None, None].astype(np.float32)))


if __name__ == "__main__":
    main()
