"""In which order moments are taken where not all can be: rare classes first, nothing twice."""

from __future__ import annotations

from bisect import bisect, insort
from collections import Counter, defaultdict
from collections.abc import Hashable, Sequence
from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray

from percept.datasets.labelling.choice.evidence import FrameEvidence, uncertainty

__all__ = ["rank"]

_FAR = 16
_PLACE, _OBJECTS = 1.5, 2.0


def rank(
    evidence: Sequence[FrameEvidence | None], drives: Sequence[str], most: int
) -> tuple[int, ...]:
    """Return which moments to take, the most worth first.

    Greedily the one with the greatest gain over those that are taken:

    - For each object that none of them shows, twice one over one plus the number of objects of its
      class that they show: rare classes come first, and no object counts again. Objects without
      a track count as one for each class and moment.
    - Half of how unsure and half of how much in disagreement its evidence is.
    - How far it is from the nearest taken one of its drive: 1.5 from 16 moments on, less nearer.

    Equal moments are taken evenly over their order. What is taken for a smaller number is taken
    for a larger one too. Gains only fall while moments are taken, so that most need not be
    computed again each time (Minoux, "Accelerated greedy algorithms", 1978).

    Args:
        evidence: What is known of each moment; None if nothing.
        drives: Drive of each; those of one are in the order of time.
        most: So many are wanted.

    Returns:
        Indices of moments, `most` of them or all.
    """
    gains = _Gains(evidence, drives)
    # Of equal gains the first of an even order is taken.
    heap = [(-gains.of(i), place, i) for place, i in enumerate(_even_order(len(drives)).tolist())]
    heapify(heap)
    taken: list[int] = []
    while heap and len(taken) < most:
        _, place, index = heappop(heap)
        fresh = (-gains.of(index), place, index)
        if heap and fresh > heap[0]:
            heappush(heap, fresh)
            continue
        gains.take(index)
        taken.append(index)
    return tuple(taken)


class _Gains:
    """What each moment adds to those that are taken."""

    def __init__(self, evidence: Sequence[FrameEvidence | None], drives: Sequence[str]) -> None:
        self._drives = drives
        self._objects = [_objects(i, drives[i], found) for i, found in enumerate(evidence)]
        self._signs = [_signs(found) for found in evidence]
        counts: Counter[str] = Counter()
        self._places = [0] * len(drives)
        for index, drive in enumerate(drives):
            self._places[index] = counts[drive]
            counts[drive] += 1
        self._shown: set[Hashable] = set()
        self._by_class: Counter[str] = Counter()
        self._taken: defaultdict[str, list[int]] = defaultdict(list)

    def of(self, index: int) -> float:
        """Return what a moment would add."""
        new = (
            _OBJECTS / (1.0 + self._by_class[label])
            for thing, label in self._objects[index].items()
            if thing not in self._shown
        )
        return sum(new) + self._signs[index] + self._distance(index)

    def take(self, index: int) -> None:
        """Take a moment."""
        for thing, label in self._objects[index].items():
            self._by_class[label] += thing not in self._shown
            self._shown.add(thing)
        insort(self._taken[self._drives[index]], self._places[index])

    def _distance(self, index: int) -> float:
        """Return what it is worth that the nearest taken moment of the drive is far."""
        place, taken = self._places[index], self._taken[self._drives[index]]
        near = bisect(taken, place)
        gaps = [abs(place - other) for other in taken[max(near - 1, 0) : near + 1]]
        return _PLACE * min([_FAR, *gaps]) / _FAR


def _objects(index: int, drive: str, moment: FrameEvidence | None) -> dict[Hashable, str]:
    """Return the objects of a moment with their classes."""
    if moment is None:
        return {}
    ids = [-1] * len(moment.labels) if moment.track_ids is None else moment.track_ids.tolist()
    return {
        (drive, track) if track >= 0 else (index, label): label
        for track, label in zip(ids, moment.labels, strict=True)
    }


def _signs(moment: FrameEvidence | None) -> float:
    if moment is None:
        return 0.0
    return (uncertainty(moment) + moment.disagreement) / 2.0


def _even_order(count: int) -> NDArray[np.intp]:
    """Return 0..count-1 so that every beginning covers all evenly (van der Corput's sequence)."""
    keys, step, numbers = np.zeros(count), 0.5, np.arange(count)
    for bit in range(count.bit_length()):
        keys += step * ((numbers >> bit) & 1)
        step /= 2.0
    return np.argsort(np.argsort(keys, kind="stable"), kind="stable")
