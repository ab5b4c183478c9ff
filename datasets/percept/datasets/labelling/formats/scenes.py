"""Stretches of a drive that are in one split: what formats call scenes or sequences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

from percept.datasets.labelling.labelled_set import Keyframe, Split

__all__ = ["Scene", "scenes_of"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """Keyframes of one drive and one split, one after the other.

    Attributes:
        name: The drive's name and a number, such as `a1b2-0`.
        drive: Name of the drive.
        split: The split.
        keyframes: In order of time.
    """

    name: str
    drive: str
    split: Split
    keyframes: tuple[Keyframe, ...]


def scenes_of(keyframes: Iterable[Keyframe]) -> tuple[Scene, ...]:
    """Return the scenes of keyframes that are in the order of drives and times.

    A drive that comes back to a split has several scenes of it: a scene never jumps over a
    stretch of another split.
    """
    numbers: Counter[str] = Counter()
    scenes = []
    for (drive, split), stretch in groupby(keyframes, key=lambda one: (one.drive, one.split)):
        name = f"{drive}-{numbers[drive]}"
        numbers[drive] += 1
        scenes.append(Scene(name=name, drive=drive, split=split, keyframes=tuple(stretch)))
    return tuple(scenes)
