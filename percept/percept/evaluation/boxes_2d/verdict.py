"""How far scores can be trusted, and the limits that this rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence

from percept.core.results import Verdict
from percept.evaluation.boxes_2d.result import Counts

__all__ = ["judge_scores"]

FEWEST_OBJECTS = 100
"""Fewer objects than this say little: a recall of 0.8 of 100 is known to 0.07 (90 %)."""
WIDEST_INTERVAL = 0.2
"""An AP50 whose 90 % interval is wider ranks no two detectors."""


def judge_scores(
    *,
    counts: Counts,
    detections: int,
    interval: tuple[float, float],
    doubts: Sequence[str],
    lost: Sequence[str],
    ranked: bool,
) -> tuple[Verdict, tuple[str, ...]]:
    """Return the verdict on the figures (not on the detector) and its reasons.

    Args:
        counts: Of all classes at the operating threshold.
        detections: Number of detections of whatever confidence.
        interval: 90 % interval of AP50.
        doubts: Sentences about what makes it likely that the figures mislead.
        lost: What could not be read or belongs to no image, as counts with their reason.
        ranked: Whether the detections have confidences that differ.
    """
    if not counts.objects:
        return Verdict.BAD, ("not one labelled object counts: there is nothing to find",)
    width = interval[1] - interval[0]
    why = []
    if not detections:
        why.append("there is not one detection: is this the right file?")
    if counts.objects < FEWEST_OBJECTS:
        why.append(f"{counts.objects} objects are few, from {FEWEST_OBJECTS} on figures are firm")
    if not math.isfinite(width):
        why.append("so few images that it cannot be told what others would give")
    elif width > WIDEST_INTERVAL:
        why.append(
            f"other images of the same kind would give an AP50 of {interval[0]:.2f} to "
            f"{interval[1]:.2f} (90 %)"
        )
    if detections and not ranked:
        why.append("all confidences are equal, so that AP does not see which detections are sure")
    why += [*doubts, *(f"left out: {text}" for text in lost)]
    if why:
        return Verdict.DOUBTFUL, tuple(why)
    return Verdict.GOOD, (
        f"{counts.objects} objects; other images of the same kind would give an AP50 of "
        f"{interval[0]:.2f} to {interval[1]:.2f} (90 %; wider where images follow each other in a "
        "drive)",
    )
