"""An ONNX network that is open: what goes in, what comes out, and what it runs on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

from percept.core.errors import DependencyError, InputError, UsageError
from percept.detection.networks.model_file import ModelFile, any_size_model, read_model_file

__all__ = ["Device", "Network", "TensorSpec", "open_network"]

Device = Literal["auto", "cpu", "cuda", "openvino"]

_PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "cpu": "CPUExecutionProvider",
}
_PACKAGES = {"cuda": "onnxruntime-gpu", "openvino": "onnxruntime-openvino"}
_DTYPES = {"float": "float32", "float16": "float16", "double": "float64"}
_IMAGE_DTYPES = ("float32", "float16", "float64", "uint8")
# onnxruntime's errors have no base of their own, and may quote names that are not UTF-8.
_ORT_ERRORS: tuple[type[Exception], ...] = (
    UnicodeDecodeError,
    *(
        kind
        for kind in vars(ort_errors).values()
        if isinstance(kind, type) and issubclass(kind, Exception)
    ),
)
_SIDES = range(32, 8193)  # pixels; anything else is no side of a detector's image
_BATCHES = range(1, 129)


@dataclass(frozen=True, slots=True)
class TensorSpec:
    """An input or output as the file declares it.

    Attributes:
        name: Of the tensor.
        shape: Its axes; None where the length is dynamic.
        dtype: As numpy names it, such as `float32`; what onnxruntime says for other things.
    """

    name: str
    shape: tuple[int | None, ...]
    dtype: str

    def __str__(self) -> str:
        axes = ", ".join("?" if n is None else str(n) for n in self.shape)
        return f"{_printable(self.name)} [{axes}]"


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """A network that runs images; many threads may call it at once.

    Attributes:
        path: The file.
        image: The input that takes images.
        channels_last: Whether that is NHWC rather than NCHW.
        inputs: All inputs.
        outputs: All outputs.
        metadata: What the file says about itself: a hint, never a fact.
        device: What really runs it.
        device_note: The same in words, with the reason.
    """

    path: Path
    image: TensorSpec
    channels_last: bool
    inputs: tuple[TensorSpec, ...]
    outputs: tuple[TensorSpec, ...]
    metadata: Mapping[str, str]
    device: Literal["cpu", "cuda", "openvino"]
    device_note: str
    session: ort.InferenceSession = field(repr=False)

    @property
    def takes_image_size(self) -> bool:
        """Whether it has an input for the size of the image, to put out boxes in the image."""
        return len(self.inputs) > 1

    def run(
        self, tensor: NDArray[Any], image_size: tuple[int, int] | None = None
    ) -> list[NDArray[Any]]:
        """Return the outputs, in the order of `outputs`.

        Args:
            tensor: (b, 3, H, W), or (b, H, W, 3) where the channels are last; any dtype, it
                becomes that of the input.
            image_size: (width, height) of the image that is in the tensor, for a network that
                takes it; the tensor's own where it is None.

        Raises:
            InputError: If the network cannot be run on it.
        """
        feeds = {self.image.name: tensor.astype(self.image.dtype, copy=False)}
        rows, columns = tensor.shape[1:3] if self.channels_last else tensor.shape[2:4]
        width, height = image_size or (columns, rows)
        for spec in self.inputs:
            if spec is not self.image:
                feeds[spec.name] = np.array([[height, width]], spec.dtype)
        try:
            return [np.asarray(output) for output in self.session.run(None, feeds)]
        except _ORT_ERRORS as e:
            raise InputError(
                f"the network fails on an input of {list(tensor.shape)}: {_plain(e)}",
                where=self.path,
            ) from e


def open_network(
    path: Path, *, device: Device = "auto", threads: int = 1, any_size: bool = False
) -> Network:
    """Open an ONNX network.

    Args:
        path: The file.
        device: What it shall run on; `auto` takes a GPU where onnxruntime has a provider for one.
        threads: Number of threads inside of one run.
        any_size: Whether images may have any size, whatever the file says (`any_size_model`).

    Raises:
        InputError: If the file must not or cannot be opened (see `read_model_file`), or it has no
            input that an image fits into.
        UsageError: If there is no such device.
        DependencyError: If onnxruntime has no provider for the device that was asked for.
    """
    providers = _providers(device)
    file = read_model_file(path)
    source = any_size_model(path) if any_size else str(path)
    session = _session(path, source, file, providers, threads)
    used = session.get_providers()[0]
    if device not in ("auto", "cpu") and used != _PROVIDERS[device]:
        raise _not_installed(device, "its provider is there but does not start")
    inputs = tuple(_spec(i) for i in session.get_inputs())
    image, channels_last = _image_input(path, inputs)
    ran_on: Literal["cpu", "cuda", "openvino"] = (
        "cuda" if used == _PROVIDERS["cuda"] else "openvino" if "OpenVINO" in used else "cpu"
    )
    return Network(
        path=path,
        image=image,
        channels_last=channels_last,
        inputs=inputs,
        outputs=tuple(_spec(o) for o in session.get_outputs()),
        metadata=file.metadata,
        device=ran_on,
        device_note=_device_note(device, ran_on, providers),
        session=session,
    )


def _providers(device: str) -> list[str]:
    """Name the providers to try, in order; never the bogus ones that onnxruntime lists."""
    if device != "auto" and device not in _PROVIDERS:
        raise UsageError(
            f"there is no device '{device}'", remedy=f"Take one of auto, {', '.join(_PROVIDERS)}"
        )
    wanted = ["cuda", "openvino"] if device == "auto" else [device]
    available = ort.get_available_providers()
    found = [_PROVIDERS[d] for d in wanted if _PROVIDERS[d] in available]
    if device != "auto" and not found:
        raise _not_installed(device, "the installed onnxruntime has no provider for it")
    return list(dict.fromkeys([*found, _PROVIDERS["cpu"]]))


def _not_installed(device: str, why: str) -> DependencyError:
    return DependencyError(
        f"the device '{device}' cannot be used: {why}",
        remedy=f"Run `pip uninstall onnxruntime && pip install {_PACKAGES[device]}`, "
        f"or take the device 'auto' or 'cpu'",
    )


def _device_note(device: str, used: str, providers: list[str]) -> str:
    version = f"onnxruntime {ort.__version__}"
    names = {"cpu": "the processor", "cuda": "a GPU through CUDA", "openvino": "OpenVINO"}
    if used == "cpu" and device == "auto":
        why = (
            "no provider for a GPU or OpenVINO is installed"
            if len(providers) == 1
            else f"{providers[0]} is installed but does not start"
        )
        return f"runs on the processor ({version}; {why})"
    return f"runs on {names[used]} ({version})"


def _session(
    path: Path, source: str | bytes, file: ModelFile, providers: list[str], threads: int
) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
    options.log_severity_level = 4  # what fails is raised; the rest is noise about the graph
    # Threads that spin while they wait take the cores from the workers that decode images.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return ort.InferenceSession(
            source, options, providers=providers, enable_fallback=len(providers) > 1
        )
    except _ORT_ERRORS as e:
        raise InputError(
            f"onnxruntime {ort.__version__} cannot open it (ir {file.ir_version}, "
            f"opset {file.opset}): {_plain(e)}",
            where=path,
            remedy="Export the network again, with opset 17, or install a newer onnxruntime",
        ) from e


def _plain(error: Exception) -> str:
    """Return what onnxruntime says without its prefixes and source paths, on one short line."""
    text = re.sub(r"\[ONNXRuntimeError\] : \d+ : \w+ : ", "", str(error))
    text = re.sub(r"Load model from .*? failed:", "", text)
    text = re.sub(r"/\S*onnxruntime\S*:\d+ .*?\)(?= [A-Z])", "", text)
    text = _printable(" ".join(text.split())).rstrip(".")
    return text if len(text) <= 240 else text[:237] + "..."


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)


def _spec(argument: ort.NodeArg) -> TensorSpec:
    shape = tuple(n if isinstance(n, int) else None for n in argument.shape or ())
    kind = re.fullmatch(r"tensor\((\w+)\)", argument.type)
    dtype = argument.type if kind is None else _DTYPES.get(kind[1], kind[1])
    return TensorSpec(argument.name, shape, dtype)


def _image_input(path: Path, inputs: tuple[TensorSpec, ...]) -> tuple[TensorSpec, bool]:
    """Find the input for images, and whether its channels are last."""
    fits = [(i, axes) for i in inputs if (axes := _channel_axes(i))]
    others = [i for i in inputs if all(i is not image for image, _ in fits)]
    if len(fits) != 1 or any(not _is_image_shape(i) for i in others):
        raise InputError(
            f"it is not a detector of one image: its inputs are {'; '.join(map(str, inputs))}",
            where=path,
            remedy="A detector takes [batch, 3, height, width] or [batch, height, width, 3]",
        )
    image, axis = fits[0]
    return image, axis == "last"


def _channel_axes(spec: TensorSpec) -> Literal["first", "last"] | None:
    if len(spec.shape) != 4 or spec.dtype not in _IMAGE_DTYPES:
        return None
    batch, *axes = spec.shape
    if batch is not None and batch not in _BATCHES:
        return None

    def side(n: int | None) -> bool:
        return n is None or n in _SIDES

    if axes[0] in (3, None) and side(axes[1]) and side(axes[2]):
        return "last" if axes[0] is None and axes[2] == 3 else "first"
    return "last" if axes[2] == 3 and side(axes[0]) and side(axes[1]) else None


def _is_image_shape(spec: TensorSpec) -> bool:
    """Tell whether this is the second input of the ONNX zoo's YOLOv3: (height, width)."""
    return "shape" in spec.name and len(spec.shape) == 2 and spec.shape[1] in (2, None)
