"""What a network's metadata say about it: hints, which the tensors may contradict.

ultralytics and YOLOv5 write Python literals into `metadata_props`; nothing of them is evaluated.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from percept.core.errors import InputError
from percept.detection.networks.class_names import as_class_names

__all__ = ["Hints", "read_hints"]

_MAX_LITERAL = 1 << 18  # characters
_STRIDES = range(4, 257)
_SIDES = range(32, 4097)


@dataclass(frozen=True, slots=True)
class Hints:
    """Hints from metadata.

    Attributes:
        task: Such as `detect` or `segment`; empty where it is not said.
        class_names: By number; None where they are missing or unusable.
        names_problem: Why names that are there are unusable, or empty.
        image_size: (width, height) that it was exported for, pixels.
        stride: Its input must be a multiple of, pixels.
    """

    task: str = ""
    class_names: tuple[str, ...] | None = None
    names_problem: str = ""
    image_size: tuple[int, int] | None = None
    stride: int | None = None


def read_hints(metadata: Mapping[str, str]) -> Hints:
    """Read the hints of ultralytics' and YOLOv5's exports; what is malformed is left out."""
    names, problem = _names(metadata["names"]) if "names" in metadata else (None, "")
    stride = _literal(metadata.get("stride", ""))
    size = _literal(metadata.get("imgsz", ""))
    sides = size if isinstance(size, list | tuple) and len(size) == 2 else (size, size)
    height, width = (_whole_number(side, _SIDES) for side in sides)
    return Hints(
        task=metadata.get("task", "").strip().lower()[:20],
        class_names=names,
        names_problem=problem,
        image_size=(width, height) if width and height else None,
        stride=_whole_number(stride, _STRIDES),
    )


def _whole_number(value: object, allowed: range) -> int | None:
    return value if isinstance(value, int) and value in allowed else None


def _names(text: str) -> tuple[tuple[str, ...] | None, str]:
    try:
        return as_class_names(_literal(text), "metadata"), ""
    except InputError as e:
        return None, e.what


def _literal(text: str) -> object:
    """Return a Python literal, or None."""
    if len(text) > _MAX_LITERAL:
        return None
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return None
