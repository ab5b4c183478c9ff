"""Objects in camera images: any YOLO in ONNX, over a whole log."""

from __future__ import annotations

__all__: list[str] = []
