"""Scores as one JSON document."""

from __future__ import annotations

import math
from typing import Any

from percept.evaluation.boxes_2d.result import AveragePrecision, BoxScores, Counts

__all__ = ["scores_as_json"]


def scores_as_json(scores: BoxScores) -> dict[str, Any]:
    """Return all scores; what there is no figure for is null."""
    return {
        "verdict": str(scores.verdict),
        "why": list(scores.why),
        "images": scores.images,
        "iou": scores.iou,
        "score": scores.score,
        **_average(scores.average),
        "ap50_interval": [_or_none(value) for value in scores.ap50_interval],
        **_counts(scores.counts),
        "by_class": {
            one.label: {
                **_average(one.average),
                **_counts(one.counts),
                "best_score": _or_none(one.best_score),
                "best_f1": _or_none(one.best_f1),
            }
            for one in scores.classes
        },
        "by_size": {
            name: {**_average(average), **_counts(counts)}
            for name, (average, counts) in scores.by_size.items()
        },
        "by_height": {band: _counts(counts) for band, counts in scores.by_height.items()},
        "by_range": {band: _counts(counts) for band, counts in scores.by_range.items()},
        "confusions": [
            {"truth": truth, "detected": detected, "count": count}
            for truth, detected, count in scores.confusions
        ],
        "mistakes": dict(scores.mistakes),
        "worst_images": [
            {"name": one.name, "objects": one.objects, "missed": one.missed, "false": one.false}
            for one in scores.worst
        ],
        "dropped": dict(scores.dropped),
        "notes": list(scores.notes),
    }


def _average(average: AveragePrecision) -> dict[str, float | None]:
    return {
        "ap50": _or_none(average.ap50),
        "ap75": _or_none(average.ap75),
        "ap": _or_none(average.ap),
        "ar": _or_none(average.ar),
    }


def _counts(counts: Counts) -> dict[str, float | None]:
    return {
        "objects": counts.objects,
        "detections": counts.detections,
        "hits": counts.hits,
        "precision": _or_none(counts.precision),
        "recall": _or_none(counts.recall),
        "f1": _or_none(counts.f1),
    }


def _or_none(value: float) -> float | None:
    # The arithmetic of COCO gives 0.9999999999999998 for what is 1.
    return round(value, 9) if math.isfinite(value) else None
