"""The words beside a box in an image, the same in views, pictures and messages."""

from __future__ import annotations

from percept.core.results import Detections2D
from percept.detection.result import Positions

__all__ = ["box_text"]


def box_text(found: Detections2D, row: int, positions: Positions | None) -> str:
    """Return a box's class, its confidence and, where it is known, its range: `car 0.92 14.1 m`.

    Args:
        found: The boxes of a model.
        row: Which of them.
        positions: Where they are in space, where any is known.
    """
    text = f"{found.labels[row]} {found.confidences[row]:.2f}"
    if positions is None or not positions.sources[row]:
        return text
    return f"{text} {positions.range_m[row]:.1f} m"
