"""The networks of a run: opened, and looked at whether they find anything in the log at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from percept.cli.detect.request import DetectConfig, ModelRequest
from percept.core.errors import UsageError
from percept.core.samples import CameraImage
from percept.detection.networks.class_names import read_class_names
from percept.detection.probe import probe_pixels
from percept.detection.yolo import YoloDetector

__all__ = ["RunningModel", "open_models", "probed"]

_STEP_PX = 64  # of any network's input


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunningModel:
    """One network of a run.

    Attributes:
        name: What the run calls it.
        every: Of each camera, it looks at one image in so many.
        detector: The network, ready.
        notes: What a user should know of it, as sentences.
    """

    name: str
    every: int
    detector: YoloDetector
    notes: tuple[str, ...] = ()

    def describe(self) -> dict[str, Any]:
        """Return all that was resolved, in the types of JSON."""
        return {**self.detector.describe(), "every": self.every, "notes": list(self.notes)}


def open_models(requests: Iterable[ModelRequest], config: DetectConfig) -> tuple[RunningModel, ...]:
    """Open the networks of a run, in their order.

    Raises:
        PerceptError: If a file is no network that can be used, or a setting does not fit it.
    """
    models = tuple(_opened(request, config) for request in requests)
    names = {model.name for model in models}
    unknown = [name for name in config.models if name not in names]
    if unknown:
        raise UsageError(
            f"there are settings for model '{unknown[0]}', which is not among the --model options",
            remedy=f"Models are {', '.join(sorted(names))}",
        )
    return models


def _opened(request: ModelRequest, config: DetectConfig) -> RunningModel:
    detector = YoloDetector(
        request.path,
        config.models[request.name],
        class_names=None if request.classes is None else read_class_names(request.classes),
        device=config.camera.device,
    )
    model = RunningModel(name=request.name, every=request.every, detector=detector)
    return _at_half_size(model) if config.camera.preview else model


def _at_half_size(model: RunningModel) -> RunningModel:
    """Return a model with half its input size, or with a note where that is fixed."""
    detector = model.detector
    width, height = detector.layout.input_size
    if not detector.describe()["rectangles"]:
        return _with_note(
            model, f"the preview keeps its input of {width} x {height}, which is fixed"
        )
    half = tuple(max(_STEP_PX, length // 2 // _STEP_PX * _STEP_PX) for length in (width, height))
    smaller = replace(
        detector.layout,
        input_size=(half[0], half[1]),
        why=(*detector.layout.why, f"preview: half of that input, {half[0]} x {half[1]}"),
    )
    return replace(model, detector=detector.with_layout(smaller))


def probed(model: RunningModel, images: Sequence[CameraImage]) -> RunningModel:
    """Look at the first images of the log, and take other pixels where only those find anything.

    Args:
        model: The network.
        images: The first images; those that are no 8-bit pictures say nothing.
    """
    pictures = [i.pixels for i in images if i.pixels.size and i.pixels.dtype.name == "uint8"]
    if not pictures:
        return model
    report = probe_pixels(model.detector, pictures)
    model = replace(model, detector=report.detector)
    return model if report.note is None else _with_note(model, report.note)


def _with_note(model: RunningModel, note: str) -> RunningModel:
    return replace(model, notes=(*model.notes, note))
