"""Detections against labels: the scores of one detector on one set of images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from percept.core.labels import LabelSet
from percept.evaluation.boxes_2d.bootstrap import ap50_interval
from percept.evaluation.boxes_2d.coco import MOST_DETECTIONS, CocoResult, run_coco
from percept.evaluation.boxes_2d.config import BoxScoreConfig
from percept.evaluation.boxes_2d.counts import (
    best_threshold,
    counts_by_height,
    counts_by_range,
    counts_by_size,
    counts_of,
)
from percept.evaluation.boxes_2d.doubts import doubts_about_boxes, doubts_about_matches
from percept.evaluation.boxes_2d.mistakes import find_mistakes
from percept.evaluation.boxes_2d.one_sided import foreign_classes, missing_classes
from percept.evaluation.boxes_2d.pairing import ImagePairs, pair_images
from percept.evaluation.boxes_2d.result import BoxScores, ClassScore
from percept.evaluation.boxes_2d.tables import (
    Compared,
    detection_table,
    truth_table,
)
from percept.evaluation.boxes_2d.verdict import judge_scores

__all__ = ["score_boxes"]

_LOW_CONFIDENCE = 0.05


def score_boxes(
    truth: LabelSet, detections: LabelSet, config: BoxScoreConfig | None = None
) -> BoxScores:
    """Score detections against labels, by the rules of COCO.

    AP takes all detections; precision, recall, F1 and the mistakes take those from
    `config.score` on and call them an object from an overlap of `config.iou` on. A region that
    the labels ignore, and an object that does not count, are neither found nor missed.

    Args:
        truth: The labels.
        detections: The detections; without confidences each has 1.
        config: What counts, or None for the defaults.

    Raises:
        UsageError: If the map of class names names one that neither has.
        InputError: If labels and detections have no image or no class in common.
    """
    config = config or BoxScoreConfig()
    pairs = pair_images(truth, detections, config.label_map)
    wanted, found = truth_table(pairs, config), detection_table(pairs)
    coco = run_coco(
        wanted,
        found,
        images=len(pairs.images),
        classes=len(pairs.classes),
        iou=config.iou,
        lowest_px=config.min_height_px,
    )
    compared = Compared(wanted, found, coco.at_iou, config.score, config.iou)
    lost = {**_unread(truth, detections), **pairs.dropped}
    dropped = {**lost, **_uncounted(pairs, compared)}
    scores = _scores(pairs, coco, compared)
    verdict, why = judge_scores(
        counts=scores.counts,
        detections=len(found),
        interval=scores.ap50_interval,
        doubts=_doubts(pairs, scores),
        lost=[f"{n} {reason}" for reason, n in lost.items() if n],
        ranked=len(np.unique(found.score)) > 1,
    )
    notes = (
        *truth.notes,
        *detections.notes,
        *pairs.notes,
        *foreign_classes(pairs.foreign, pairs.classes),
        *_notes(compared, detections),
    )
    dropped = {reason: count for reason, count in dropped.items() if count}
    return replace(scores, dropped=dropped, notes=notes, verdict=verdict, why=why)


def _scores(pairs: ImagePairs, coco: CocoResult, compared: Compared) -> BoxScores:
    """Return all figures, without what is said about them."""
    images, classes = len(pairs.images), len(pairs.classes)
    names = [labelled.name for labelled, _ in pairs.images]
    mistakes = find_mistakes(compared, names=names, classes=pairs.classes)
    sizes = counts_by_size(compared)
    return BoxScores(
        iou=compared.iou,
        score=compared.score,
        images=images,
        average=coco.overall,
        ap50_interval=ap50_interval(
            compared.truth, compared.found, coco.at_half, images=images, classes=classes
        ),
        counts=counts_of(compared, None),
        classes=_class_scores(pairs, coco, compared),
        by_size={name: (coco.by_size[name], count) for name, count in sizes.items()},
        by_height=counts_by_height(compared),
        by_range=counts_by_range(compared),
        confusions=mistakes.confusions,
        mistakes=mistakes.kinds,
        worst=mistakes.worst,
    )


def _class_scores(
    pairs: ImagePairs, coco: CocoResult, compared: Compared
) -> tuple[ClassScore, ...]:
    scores = []
    for place, label in enumerate(pairs.classes):
        best_score, best_f1 = best_threshold(compared, place)
        scores.append(
            ClassScore(
                label=label,
                average=coco.by_class[place],
                counts=counts_of(compared, place),
                best_score=best_score,
                best_f1=best_f1,
                precision_at_recall=coco.precision_at_recall[place],
            )
        )
    return tuple(scores)


def _doubts(pairs: ImagePairs, scores: BoxScores) -> list[str]:
    doubts = [*pairs.doubts, *doubts_about_boxes(pairs)]
    if any(labelled.confidences is not None for labelled, _ in pairs.images):
        doubts.append("the labels have confidences: are they detections?")
    confused = sum(count for _, _, count in scores.confusions)
    doubts += doubts_about_matches(scores.counts, confused)
    return doubts + missing_classes(scores.classes, pairs.foreign)


def _uncounted(pairs: ImagePairs, compared: Compared) -> dict[str, int]:
    """Count the objects and detections of the compared images that do not count."""
    truth, found = compared.truth, compared.found
    groups = found.image * (1 + found.label.max(initial=0)) + found.label
    surplus = sum(max(0, n - MOST_DETECTIONS) for n in np.unique(groups, return_counts=True)[1])
    ignored = int((~compared.matches.counted).sum()) - surplus
    return {
        "detections of classes that the labels do not have": sum(pairs.foreign.values()),
        "objects lower or less visible than what counts": int(
            (~truth.counted & ~truth.region).sum()
        ),
        "detections in ignored regions or on objects that do not count": ignored,
        f"detections beyond the {MOST_DETECTIONS} best of a class in an image": surplus,
    }


def _unread(truth: LabelSet, detections: LabelSet) -> dict[str, int]:
    sides = {"labels": truth.dropped, "detections": detections.dropped}
    return {
        f"{reason} ({side})": n for side, dropped in sides.items() for reason, n in dropped.items()
    }


def _notes(compared: Compared, detections: LabelSet) -> list[str]:
    found = compared.found
    if any(image.confidences is None and len(image) for image in detections.images):
        return ["the detections have no confidences: each counts with 1"]
    if not len(found):
        return []
    notes = []
    if found.score.max() < compared.score:
        notes.append(
            f"no detection has a confidence of {compared.score:g}: all counts are without any"
        )
    if found.score.min() > _LOW_CONFIDENCE:
        notes.append(
            f"no detection has a confidence below {found.score.min():.2f}: AP lacks what the "
            "detector left out; detect with --score 0.01 to compare with published figures"
        )
    return notes
