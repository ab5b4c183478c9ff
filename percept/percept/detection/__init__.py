"""Objects in camera images: any YOLO in ONNX, over a whole log.

The network's runtime and the compiled kernels are loaded when a detector is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from percept.detection.yolo import YoloDetector
    from percept.detection.yolo_config import YoloConfig

__all__ = ["YoloConfig", "YoloDetector"]

_HOMES = {"YoloConfig": "yolo_config", "YoloDetector": "yolo"}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the module holds
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
