"""Settings of the scores of 2D boxes."""

from __future__ import annotations

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["BoxScoreConfig"]


class BoxScoreConfig(Settings):
    """What counts, and at which overlap and confidence.

    Attributes:
        iou: Overlap from which a detection is its object, for the counts; AP has its own.
        score: Confidence from which a detection counts, for the counts; AP takes all.
        min_height_px: Lower objects do not count, and lower detections that are no object.
        min_visible: Objects of which a smaller share can be seen do not count; those of which
            it is not known do.
        label_map: New name by class name, for labels and detections alike.
    """

    iou: float = Field(0.5, gt=0.0, le=1.0)
    score: float = Field(0.25, ge=0.0, le=1.0)
    min_height_px: float = Field(0.0, ge=0.0)
    min_visible: float = Field(0.0, ge=0.0, le=1.0)
    label_map: dict[str, str] = Field(default_factory=dict)
