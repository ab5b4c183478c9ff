"""Tracks against truth: CLEAR-MOT, IDF1, HOTA, sAMOTA, and the velocities."""

from __future__ import annotations

from percept.evaluation.tracks.clear import ClearScores, clear_scores, match_over_time
from percept.evaluation.tracks.drive import (
    ClassTrackScores,
    DriveTruth,
    align_frames,
    read_drive_truth,
    score_drive,
)
from percept.evaluation.tracks.frames import TrackFrame, pair_frames
from percept.evaluation.tracks.hota import HotaScores, hota_scores
from percept.evaluation.tracks.identity import IdentityScores, identity_scores
from percept.evaluation.tracks.kitti_scores import KittiScores, score_kitti
from percept.evaluation.tracks.replay import detection_scans, full_tracks, tracked_boxes
from percept.evaluation.tracks.scores import TrackScores, score_frames
from percept.evaluation.tracks.similarity import centre_closeness, image_iou, space_iou

__all__ = [
    "ClassTrackScores",
    "ClearScores",
    "DriveTruth",
    "HotaScores",
    "IdentityScores",
    "KittiScores",
    "TrackFrame",
    "TrackScores",
    "align_frames",
    "centre_closeness",
    "clear_scores",
    "detection_scans",
    "full_tracks",
    "hota_scores",
    "identity_scores",
    "image_iou",
    "match_over_time",
    "pair_frames",
    "read_drive_truth",
    "score_drive",
    "score_frames",
    "score_kitti",
    "space_iou",
    "tracked_boxes",
]
