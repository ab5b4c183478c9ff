"""Tracks and labels in MOTChallenge text."""

from __future__ import annotations

from pathlib import Path

from percept.cli.eval.tracks_result import TrackEvalRun
from percept.datasets.labels.mot import read_mot
from percept.evaluation.tracks import image_iou, pair_frames, score_frames

__all__ = ["score_mot"]


def score_mot(tracks: Path, labels: Path) -> TrackEvalRun:
    """Score one sequence by the IoU of its boxes in the image, at least 0.5.

    Raises:
        InputError: If a file is none of the format.
    """
    truth, dropped = read_mot(labels, labels=True)
    made, _ = read_mot(tracks, labels=False)
    scores = score_frames(pair_frames(truth, made, image_iou))
    figures = scores.document()
    return TrackEvalRun(
        document={"format": "mot", "frames": scores.clear.frames, **figures},
        rows={"all": figures},
        objects=scores.clear.objects,
        inputs=[tracks, labels],
        dropped=dropped,
    )
