"""A tracker on KITTI's sequences: every class at every overlap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from percept.core.tracked_boxes import TrackedBoxes
from percept.evaluation.tracks.frames import Similarity
from percept.evaluation.tracks.kitti_rules import KITTI_CLASSES, KittiSequence
from percept.evaluation.tracks.recalls import RecallScores, score_recalls
from percept.evaluation.tracks.scores import TrackScores, figure, score_frames
from percept.evaluation.tracks.similarity import image_iou, space_iou

__all__ = ["KITTI_OVERLAPS", "KittiScores", "score_kitti"]

KITTI_OVERLAPS: dict[str, tuple[Similarity, float]] = {
    "3d_0.25": (space_iou, 0.25),
    "3d_0.50": (space_iou, 0.5),
    "3d_0.70": (space_iou, 0.7),
    "2d_0.50": (image_iou, 0.5),
}
"""The overlaps that pairs must have: IoU in space, or in the image."""


@dataclass(frozen=True, slots=True)
class KittiScores:
    """One class at one overlap.

    Attributes:
        recalls: sAMOTA and what belongs to it, by the rules of the benchmark.
        best: HOTA, IDF1 and CLEAR-MOT at the score with the highest MOTA, of what counts.
    """

    recalls: RecallScores
    best: TrackScores

    def document(self) -> dict[str, float | None]:
        """Return all figures by name.

        Counts, MOTA and MOTP (the mean overlap) are the benchmark's, at the score with the
        highest MOTA; `switches_over_gaps` are those of CLEAR-MOT.
        """
        recalls, counts, best = self.recalls, self.recalls.best, self.best
        return {
            "samota": figure(recalls.samota),
            "amota": figure(recalls.amota),
            "amotp": figure(recalls.amotp),
            "mota": figure(counts.mota),
            "motp": figure(counts.motp),
            "hota": figure(best.hota.hota),
            "det_a": figure(best.hota.det_a),
            "ass_a": figure(best.hota.ass_a),
            "loc_a": figure(best.hota.loc_a),
            "idf1": figure(best.identity.idf1),
            "precision": figure(counts.precision),
            "recall": figure(counts.recall),
            "num_switches": counts.switches,
            "switches_over_gaps": best.clear.switches,
            "num_fragmentations": counts.fragmentations,
            "num_false_positives": counts.false_positives,
            "num_misses": counts.misses,
            "num_objects": counts.objects,
            "mostly_tracked": counts.mostly_tracked,
            "partially_tracked": counts.partially_tracked,
            "mostly_lost": counts.mostly_lost,
            "least_score": figure(recalls.best_score),
        }


def score_kitti(
    sequences: Sequence[tuple[TrackedBoxes, TrackedBoxes]],
    progress: Callable[[float], None] = lambda _share: None,
) -> dict[str, dict[str, KittiScores]]:
    """Score each class that the labels have, at each of `KITTI_OVERLAPS`.

    Args:
        sequences: Labels and tracks of each sequence.
        progress: Is told the share that is done.

    Raises:
        InputError: If an identity comes twice in a frame.
    """
    scores: dict[str, dict[str, KittiScores]] = {}
    cases = [(label, name) for label in KITTI_CLASSES for name in KITTI_OVERLAPS]
    for done, (label, name) in enumerate(cases):
        similarity, least = KITTI_OVERLAPS[name]
        parts = [KittiSequence(*pair, label, similarity, least) for pair in sequences]
        if any(part.objects for part in parts):
            recalls = score_recalls(parts)
            frames = (part.frames(recalls.best_score) for part in parts)
            best = sum((score_frames(one, least) for one in frames), TrackScores())
            scores.setdefault(label, {})[name] = KittiScores(recalls, best)
        progress((done + 1) / len(cases))
    return scores
