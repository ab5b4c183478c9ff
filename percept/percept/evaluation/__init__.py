"""Results against truth: ground, clusters and 3D detections."""

from __future__ import annotations

from percept.evaluation.bands import RANGE_BANDS, range_band
from percept.evaluation.detections import DetectionScores, Match, match_detections
from percept.evaluation.runs import read_poses, score_run
from percept.evaluation.segmentation import (
    GroundScores,
    ObjectScore,
    SegmentationScores,
    ground_scores,
    points_in_box,
    score_clusters,
)

__all__ = [
    "RANGE_BANDS",
    "DetectionScores",
    "GroundScores",
    "Match",
    "ObjectScore",
    "SegmentationScores",
    "ground_scores",
    "match_detections",
    "points_in_box",
    "range_band",
    "read_poses",
    "score_clusters",
    "score_run",
]
