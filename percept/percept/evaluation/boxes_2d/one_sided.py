"""Classes that only the labels or only the detections have: named, so that none goes unnoticed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from percept.evaluation.boxes_2d.result import ClassScore

__all__ = ["foreign_classes", "missing_classes"]


def missing_classes(scores: Sequence[ClassScore], foreign: Iterable[str]) -> list[str]:
    """Say which classes have objects and not one detection, and what AP50 is without them.

    Args:
        scores: The classes of the labels.
        foreign: Classes of the detections that the labels do not have.

    Returns:
        One sentence, or none.
    """
    with_objects = [one for one in scores if one.counts.objects]
    missing = [one for one in with_objects if np.isnan(one.best_score)]
    if not missing:
        return []
    rest = [one.average.ap50 for one in with_objects if one not in missing]
    named = ", ".join(f"{one.label} ({one.counts.objects})" for one in missing)
    without = f"; without them AP50 is {np.mean(rest):.3f}" if rest else ""
    hints = _hints([one.label for one in missing], foreign)
    return [f"not one detection of {named}, whose AP of 0 is in the mean{without}{hints}"]


def foreign_classes(foreign: Mapping[str, int], classes: Iterable[str]) -> list[str]:
    """Say which classes of the detections the labels do not have.

    Args:
        foreign: Number of detections by class.
        classes: The classes of the labels.

    Returns:
        One sentence, or none.
    """
    if not foreign:
        return []
    named = ", ".join(f"{label} ({n})" for label, n in foreign.items())
    hints = _hints(foreign, classes)
    return [f"detections of classes that the labels do not have count for nothing: {named}{hints}"]


def _hints(names: Iterable[str], others: Iterable[str]) -> str:
    """Return the maps to pass for names that differ in capitals only."""
    folded = {other.casefold(): other for other in others}
    maps = [
        f"--map {name}={folded[name.casefold()]}" for name in names if name.casefold() in folded
    ]
    return f". The same under another name? Then {' '.join(maps)}" if maps else ""
