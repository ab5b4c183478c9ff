"""All figures of a tracker on frames, in one value that adds up over sequences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from percept.evaluation.tracks.clear import ClearScores, clear_scores, match_over_time
from percept.evaluation.tracks.frames import TrackFrame
from percept.evaluation.tracks.hota import HotaScores, hota_scores
from percept.evaluation.tracks.identity import IdentityScores, identity_scores

__all__ = ["TrackScores", "figure", "score_frames"]

_DIGITS = 9


@dataclass(frozen=True, slots=True)
class TrackScores:
    """CLEAR-MOT, IDF1 and HOTA of one class, or of all."""

    clear: ClearScores = field(default_factory=ClearScores)
    identity: IdentityScores = field(default_factory=IdentityScores)
    hota: HotaScores = field(default_factory=HotaScores)

    def __add__(self, other: TrackScores) -> TrackScores:
        return TrackScores(
            self.clear + other.clear, self.identity + other.identity, self.hota + other.hota
        )

    def document(self) -> dict[str, float | None]:
        """Return all figures by name; what there is no figure for is None."""
        clear, identity = self.clear, self.identity
        return {
            "mota": figure(clear.mota),
            "motp": figure(clear.motp),
            "idf1": figure(identity.idf1),
            "idp": figure(identity.idp),
            "idr": figure(identity.idr),
            "precision": figure(clear.precision),
            "recall": figure(clear.recall),
            "num_switches": clear.switches,
            "num_fragmentations": clear.fragmentations,
            "num_false_positives": clear.false_positives,
            "num_misses": clear.misses,
            "num_objects": clear.objects,
            "mostly_tracked": clear.mostly_tracked,
            "partially_tracked": clear.partially_tracked,
            "mostly_lost": clear.mostly_lost,
            "hota": figure(self.hota.hota),
            "det_a": figure(self.hota.det_a),
            "ass_a": figure(self.hota.ass_a),
            "loc_a": figure(self.hota.loc_a),
        }


def score_frames(frames: Sequence[TrackFrame], least: float = 0.5) -> TrackScores:
    """Score one sequence.

    Args:
        frames: The frames in order.
        least: Similarity from which CLEAR-MOT and IDF1 take a pair; HOTA takes all of them.
    """
    matches = match_over_time(frames, least)
    return TrackScores(
        clear_scores(frames, matches), identity_scores(frames, least), hota_scores(frames)
    )


def figure(value: float) -> float | None:
    """Return a number for a document: no more digits than mean something; None of NaN."""
    return round(value, _DIGITS) if math.isfinite(value) else None
