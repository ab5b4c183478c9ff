"""The run behind `percept detect quantize`: from a network and a log to a quantised network."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from percept.cli.detect.flags import model_file
from percept.cli.progress import progress_bar
from percept.core.errors import DecodeError, GeometryError, InsufficientDataError, UsageError
from percept.core.results import Verdict
from percept.core.samples import CameraImage
from percept.datasets import open_recording
from percept.datasets.camera_topics import first_image
from percept.datasets.recording import UndecodedMessage
from percept.detection.agreement import (
    Agreement,
    Picture,
    compare_detectors,
    judge_agreement,
)
from percept.detection.images.pixels import as_bgr8
from percept.detection.networks.class_names import read_class_names
from percept.detection.probe import probe_pixels
from percept.detection.quantize import QuantizedLayers, quantize_network
from percept.detection.yolo import YoloDetector

__all__ = ["QuantizeRequest", "run_quantization"]

_PROBED_IMAGES = 4
_LEAST_IMAGES = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class QuantizeRequest:
    """What the command line asked for; see the options of `percept detect quantize`."""

    model: str
    calibration: Path
    out: Path | None = None
    images: int = 64
    classes: Path | None = None
    force: bool = False


def run_quantization(request: QuantizeRequest) -> dict[str, Any]:
    """Quantise a network, measure it, and write it unless it is bad; return all in JSON's types.

    Raises:
        PerceptError: If the network, the log or the output cannot be used.
    """
    source = model_file(request.model)
    target = request.out or Path(f"{source.stem}_int8.onnx")
    _check_target(target, source, force=request.force)
    names = None if request.classes is None else read_class_names(request.classes)
    resolved = YoloDetector(source, class_names=names, device="cpu")
    images = _choose_images(request.calibration, request.images)
    report = probe_pixels(resolved, list(islice(images.read(images.calibration), _PROBED_IMAGES)))
    dropped: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".percept-") as folder:
        made = Path(folder) / target.name
        layers = _quantize(report.detector, made, images, dropped)
        other = YoloDetector(made, class_names=names, device="cpu")
        found = _compare(report.detector, other, images, dropped)
        verdict, why = judge_agreement(found)
        if replace(other.layout, why=()) != replace(resolved.layout, why=()):
            verdict, why = Verdict.BAD, (f"it now passes for '{other.layout.name}'", *why)
        sizes = {"float": source.stat().st_size, "int8": made.stat().st_size}
        if verdict.exit_code == 0:
            made.replace(target)
    return {
        "model": str(source),
        "out": str(target) if verdict.exit_code == 0 else None,
        "verdict": verdict.value,
        "why": list(why),
        "exit_code": verdict.exit_code,
        "layers": {"quantized": layers.quantized, "kept": layers.kept},
        "images": {"calibration": layers.images, "compared": found.images},
        "agreement": found.to_dict(),
        "bytes": sizes,
        "dropped": dict(dropped),
        "notes": [*images.notes, *([] if report.note is None else [report.note])],
    }


def _check_target(target: Path, source: Path, *, force: bool) -> None:
    if target.resolve() == source.resolve():
        raise UsageError("--out is the network itself, which is never changed", where=target)
    if not target.parent.is_dir():
        raise UsageError("there is no such folder", where=target.parent, remedy="Make it first")
    if target.exists() and not (force and target.is_file()):
        raise UsageError("it exists", where=target, remedy="Give another --out, or --force")


@dataclass(frozen=True, slots=True)
class _LogImages:
    """Images of a log by number, over all cameras and in the order of the log."""

    path: Path
    topics: tuple[str, ...]
    calibration: frozenset[int]
    compared: frozenset[int]
    depth_topics: tuple[str, ...]

    @property
    def notes(self) -> list[str]:
        """What a user should know of them, as clauses."""
        return [f"the depth images in {topic} are left alone" for topic in self.depth_topics]

    def read(
        self, numbers: frozenset[int], dropped: Counter[str] | None = None
    ) -> Iterator[Picture]:
        """Yield the images of these numbers as BGR; those that are no pictures are counted."""
        with open_recording(self.path) as recording:
            for number, message in enumerate(recording.undecoded(topics=self.topics)):
                if number not in numbers:
                    continue
                try:
                    yield _picture_in(message)
                except (DecodeError, GeometryError) as error:
                    if dropped is not None:
                        dropped[f"images of {message.topic} ({error.what})"] += 1


def _picture_in(message: UndecodedMessage) -> Picture:
    for sample in message.decode():
        if isinstance(sample, CameraImage):
            return as_bgr8(sample.pixels)
    raise DecodeError("no image", where=message.topic)


def _choose_images(path: Path, wanted: int) -> _LogImages:
    """Spread images evenly over a log; every third is kept for the comparison."""
    with open_recording(path) as recording:
        every = [t for t in recording.topics() if t.sample_type is CameraImage and t.count]
        depths = {t.topic for t in every if first_image(recording, t.topic).is_depth}
    found = [topic for topic in every if topic.topic not in depths]
    count = sum(topic.count for topic in found)
    if count < _LEAST_IMAGES:
        raise InsufficientDataError(
            f"it has {count} images, which cannot both calibrate and compare",
            where=path,
            remedy="Give a log with images of what the network is for",
        )
    chosen = min(count, wanted + math.ceil(wanted / 2))
    numbers = [number * (count - 1) // (chosen - 1) for number in range(chosen)]
    compared = frozenset(numbers[1::3])
    topics = tuple(topic.topic for topic in found)
    return _LogImages(path, topics, frozenset(numbers) - compared, compared, tuple(sorted(depths)))


def _quantize(
    detector: YoloDetector, target: Path, images: _LogImages, dropped: Counter[str]
) -> QuantizedLayers:
    with progress_bar("looking at ranges", len(images.calibration)) as advance:
        pictures = images.read(images.calibration, dropped)
        tensors = (detector.prepare(p)[0] for p in _counted(pictures, advance))
        return quantize_network(detector.network, target, tensors)


def _compare(
    detector: YoloDetector, other: YoloDetector, images: _LogImages, dropped: Counter[str]
) -> Agreement:
    """Compare on images that the ranges do not come from, as if both had been resolved alike."""
    with progress_bar("comparing", len(images.compared)) as advance:
        pictures = _counted(images.read(images.compared, dropped), advance)
        found = compare_detectors(detector, other.with_layout(detector.layout), pictures)
    if not found.boxes:
        raise InsufficientDataError(
            f"the network finds nothing in {found.images} images, so that there is nothing to "
            "compare",
            where=images.path,
            remedy="Give a log with objects that it knows",
        )
    return found


def _counted(pictures: Iterator[Picture], advance: Callable[[float], None]) -> Iterator[Picture]:
    for number, picture in enumerate(pictures, 1):
        yield picture
        advance(number)
