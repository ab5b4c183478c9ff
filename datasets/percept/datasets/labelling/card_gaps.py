"""What a data set lacks, as far as its tables show it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet

__all__ = ["known_gaps"]

_MOST_NAMES = 5


def known_gaps(labelled: LabelledSet) -> Iterator[str]:
    """Yield what is missing or weak in a set, as sentences."""
    yield from _empty_splits(labelled)
    yield from _classes(labelled)
    yield from _boxes(labelled)
    yield from _sensors(labelled)
    if not labelled.licence:
        yield "No licence was given."


def _empty_splits(labelled: LabelledSet) -> Iterator[str]:
    held = Counter(one.split for one in labelled.keyframes)
    for split in SPLITS:
        if not held[split]:
            yield f"The split {split} is empty: too few places, or too near to each other."


def _classes(labelled: LabelledSet) -> Iterator[str]:
    counts: Counter[tuple[str, str]] = Counter()
    for one in labelled.keyframes:
        counts.update((one.split, label) for label in one.solids.labels)
        for frame in one.frames:
            counts.update((one.split, label) for label in frame.boxes.labels)
    for split in sorted({one.split for one in labelled.keyframes}, key=SPLITS.index):
        missing = [label for label in labelled.categories if not counts[split, label]]
        if missing:
            yield f"In {split} there is no {_listed(missing)}."


def _boxes(labelled: LabelledSet) -> Iterator[str]:
    sources: Counter[bool] = Counter()
    bare = 0
    for one in labelled.keyframes:
        sources.update(bool(source) for source in one.solids.sources)
        for frame in one.frames:
            bare += not len(frame.boxes)
            sources.update(bool(source) for source in frame.boxes.sources)
    if sources[True]:
        yield f"{sources[True]:,} of {sources.total():,} boxes no person has looked at."
    if bare:
        images = sum(len(one.frames) for one in labelled.keyframes)
        yield f"{bare:,} of {images:,} images have no box; whether they show nothing is not known."


def _sensors(labelled: LabelledSet) -> Iterator[str]:
    moments = len(labelled.keyframes)
    unplaced = sum(math.isnan(one.latitude + one.longitude) for one in labelled.keyframes)
    if unplaced:
        yield f"Of {unplaced:,} of {moments:,} moments it is not known where they are."
    without = sum(one.scan is None for one in labelled.keyframes)
    if without:
        yield f"{without:,} of {moments:,} moments have no LiDAR points."
    lenses = [labelled.camera_of(*both) for both in labelled.frames()]
    if unknown := sum(camera is None for camera in lenses):
        yield f"Of {unknown:,} of {len(lenses):,} images the lens is not known."


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f"{shown} and {more} other classes" if more > 0 else shown
