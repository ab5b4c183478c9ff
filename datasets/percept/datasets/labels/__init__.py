"""2D labels and detections in the formats of others, read into one type."""

from __future__ import annotations

from percept.datasets.labels.open import (
    LabelFormat,
    label_format,
    read_detections,
    read_labels,
)

__all__ = ["LabelFormat", "label_format", "read_detections", "read_labels"]
