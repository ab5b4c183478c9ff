"""2D boxes against labels, by the rules of COCO."""

from __future__ import annotations

from percept.evaluation.boxes_2d.config import BoxScoreConfig
from percept.evaluation.boxes_2d.document import scores_as_json
from percept.evaluation.boxes_2d.result import (
    AveragePrecision,
    BoxScores,
    ClassScore,
    Counts,
    ImageMistakes,
)
from percept.evaluation.boxes_2d.score import score_boxes

__all__ = [
    "AveragePrecision",
    "BoxScoreConfig",
    "BoxScores",
    "ClassScore",
    "Counts",
    "ImageMistakes",
    "score_boxes",
    "scores_as_json",
]
