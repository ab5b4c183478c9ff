"""The detector that ships; `builtin.md` beside it says what it is and is not for."""

from __future__ import annotations

from pathlib import Path

__all__ = ["builtin_model"]


def builtin_model() -> Path:
    """Return the ONNX file of the detector that ships with percept.

    It is a network in the `v8` layout like any other, and knows only the synthetic world.
    """
    return Path(__file__).with_name("builtin.onnx")
