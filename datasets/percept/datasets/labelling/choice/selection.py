"""Decides which images of all logs are labelled: a pure function of their looks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from percept.core.settings import Settings
from percept.datasets.labelling.choice.duplicates import DuplicateConfig, DuplicateFinder
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.image_look import ImageLook
from percept.datasets.labelling.choice.image_quality import PoorReason, QualityConfig, poor_images
from percept.datasets.labelling.choice.ranking import rank

__all__ = ["Candidate", "Decision", "DropReason", "SelectionConfig", "decide"]

DropReason = PoorReason | Literal["duplicate", "budget"]
"""Why an image is not labelled."""


class SelectionConfig(Settings):
    """How images are chosen among those that were decoded.

    Attributes:
        quality: Which images are poor; None keeps them.
        duplicates: Which images show the same; None keeps them.
    """

    quality: QualityConfig | None = Field(default_factory=QualityConfig)
    duplicates: DuplicateConfig | None = Field(default_factory=DuplicateConfig)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Candidate:
    """An image that may be labelled, or the scan of a keyframe that has no image.

    Attributes:
        drive: Name of its drive.
        camera: Name of its camera; empty for a scan alone.
        stamp_ns: When it was taken.
        keyframe_ns: The moment of its keyframe; images of one drive and moment belong together.
        look: How it looks; None for a scan alone, which is never poor nor a duplicate.
        evidence: What is known of the keyframe's moment; None if nothing.
    """

    drive: str
    camera: str
    stamp_ns: int
    keyframe_ns: int
    look: ImageLook | None
    evidence: FrameEvidence | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What becomes of a candidate.

    Attributes:
        dropped: Why it is not labelled; None where it is.
        of: For a duplicate, the index of the candidate that it repeats. With a budget, that one
            may itself be left out for the budget. None for all others.
    """

    dropped: DropReason | None = None
    of: int | None = None


def decide(
    candidates: Sequence[Candidate], config: SelectionConfig, budget: int | None = None
) -> tuple[Decision, ...]:
    """Decide about all candidates.

    Poor images go first; of those that show the same, the first in the order stays. Without a
    budget, whatever comes after a drive changes nothing for it: all decisions stay when later
    logs are appended. With a budget all keyframes compete, and those of earlier logs may have to
    go when a log is added.

    Args:
        candidates: Drives in the order of their start, the images of each in the order of time,
            those of a keyframe together.
        config: Settings.
        budget: So many images at most, as whole keyframes; None for all.

    Returns:
        One decision for each candidate, in their order.
    """
    decisions = [Decision() for _ in candidates]
    if config.quality is not None:
        for index, reason in _poor(candidates, config.quality):
            decisions[index] = Decision(dropped=reason)
    if config.duplicates is not None:
        for index, of in _repeated(candidates, _kept(decisions), config.duplicates):
            decisions[index] = Decision(dropped="duplicate", of=of)
    if budget is not None:
        for index in _over_budget(candidates, _kept(decisions), budget):
            decisions[index] = Decision(dropped="budget")
    return tuple(decisions)


def _kept(decisions: Sequence[Decision]) -> list[int]:
    return [index for index, decision in enumerate(decisions) if decision.dropped is None]


def _poor(
    candidates: Sequence[Candidate], config: QualityConfig
) -> Iterable[tuple[int, PoorReason]]:
    """Yield the poor images with what is wrong, judged by what their camera shows in the drive."""
    by_camera: dict[tuple[str, str], list[tuple[int, ImageLook]]] = {}
    for index, candidate in enumerate(candidates):
        if candidate.look is not None:
            key = candidate.drive, candidate.camera
            by_camera.setdefault(key, []).append((index, candidate.look))
    for members in by_camera.values():
        reasons = poor_images([look for _, look in members], config)
        for (index, _), reason in zip(members, reasons, strict=True):
            if reason is not None:
                yield index, reason


def _repeated(
    candidates: Sequence[Candidate], kept: Sequence[int], config: DuplicateConfig
) -> Iterable[tuple[int, int]]:
    """Yield the images that show what an earlier one shows, each with that one.

    Images of one keyframe are no duplicates of each other: cameras that look the same way are
    meant to.
    """
    finder = DuplicateFinder(config)
    offered: list[int] = []
    groups = _keyframes(candidates)
    for index in kept:
        look = candidates[index].look
        if look is None:
            continue
        offered.append(index)
        found = finder.offer(look, group=groups[index])
        if found is not None:
            yield index, offered[found]


def _over_budget(
    candidates: Sequence[Candidate], kept: Sequence[int], budget: int
) -> Iterable[int]:
    """Yield the images of the keyframes that are not taken: the first too large ends the taking."""
    groups = _keyframes(candidates)
    members: dict[int, list[int]] = {}
    for index in kept:
        members.setdefault(groups[index], []).append(index)
    moments = list(members.values())
    first = [candidates[images[0]] for images in moments]
    room, taken = budget, set()
    for moment in rank([c.evidence for c in first], [c.drive for c in first], budget):
        room -= len(moments[moment])
        if room < 0:
            break
        taken.add(moment)
    for moment, images in enumerate(moments):
        if moment not in taken:
            yield from images


def _keyframes(candidates: Sequence[Candidate]) -> list[int]:
    """Return the number of each candidate's keyframe."""
    numbers: dict[tuple[str, int], int] = {}
    return [numbers.setdefault((c.drive, c.keyframe_ns), len(numbers)) for c in candidates]
