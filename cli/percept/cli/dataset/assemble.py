"""From what was decoded to the set: what is kept, which part it is in, which boxes it has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from percept.cli.dataset.journal import CollectedImage, Journal
from percept.cli.dataset.keyframes import KeyframeMaker
from percept.cli.dataset.place import PlacedMoment
from percept.cli.dataset.request import PrepareConfig
from percept.datasets.labelling.choice.evidence import FrameEvidence
from percept.datasets.labelling.choice.moments import evidence_near
from percept.datasets.labelling.choice.selection import Candidate, Decision, decide
from percept.datasets.labelling.dropped import DroppedFrame
from percept.datasets.labelling.labelled_set import (
    Drive,
    Keyframe,
)
from percept.datasets.labelling.names import safe_name

__all__ = ["Assembled", "assemble"]

_EVIDENCE_NEAR_NS = 600_000_000
"""Runs say what they know once a second."""


@dataclass(slots=True)
class Assembled:
    """The content of a set.

    Attributes:
        keyframes: In the order of logs and times.
        dropped: What is not in it, with reasons.
        unlabelled: Boxes that are no pre-labels, by reason.
    """

    keyframes: list[Keyframe] = field(default_factory=list)
    dropped: list[DroppedFrame] = field(default_factory=list)
    unlabelled: Counter[str] = field(default_factory=Counter)


def assemble(
    folder: Path,
    placed: Sequence[PlacedMoment],
    journal: Journal,
    drives: Mapping[str, Drive],
    config: PrepareConfig,
    budget: int | None,
    on_keyframe: Callable[[], None],
) -> Assembled:
    """Decide what is in the set, and give it its boxes.

    Args:
        folder: Where the files are.
        placed: All keyframes, in the order of logs and times.
        journal: What was decoded.
        drives: The logs by name.
        config: Settings.
        budget: Most images; None for all.
        on_keyframe: Is called before each keyframe.
    """
    assembled = Assembled()
    candidates, owners = _candidates(placed, journal)
    decisions = decide(candidates, config.selection, budget)
    files = [
        _file_of(candidate, owner, journal)
        for candidate, owner in zip(candidates, owners, strict=True)
    ]
    for candidate, owner, decision in zip(candidates, owners, decisions, strict=True):
        if decision.dropped is not None:
            repeated = "" if decision.of is None else files[decision.of]
            assembled.dropped.append(
                _dropped(
                    folder, owner, candidate.camera, candidate.stamp_ns, decision.dropped, repeated
                )
            )
    assembled.dropped += _never_candidates(folder, placed, journal)
    runs = {id(one.plan): one.plan.source.run for one in placed}
    for run in filter(None, runs.values()):
        run.dropped.clear()  # of what was asked while keyframes were chosen
    kept = _kept_by_moment(candidates, owners, decisions)
    maker = KeyframeMaker(folder, journal, drives, config.prelabels)
    for one in placed:
        if (one.plan.name, one.key_ns) in kept:
            on_keyframe()
            assembled.keyframes.append(maker.make(one, kept[one.plan.name, one.key_ns]))
    assembled.unlabelled.update(maker.dropped)
    for run in filter(None, runs.values()):
        assembled.unlabelled.update(run.dropped)
    return assembled


def _images(one: PlacedMoment, journal: Journal) -> Iterator[tuple[str, CollectedImage]]:
    for topic, stamp_ns in one.moment.images.items():
        image = journal.images.get((one.plan.name, topic, stamp_ns))
        if image is not None:
            yield topic, image


def _candidates(
    placed: Sequence[PlacedMoment], journal: Journal
) -> tuple[list[Candidate], list[PlacedMoment]]:
    candidates: list[Candidate] = []
    owners: list[PlacedMoment] = []
    known: dict[tuple[str, int], FrameEvidence | None] = {}
    for plan in {id(one.plan): one.plan for one in placed}.values():
        moments = [one.key_ns for one in placed if one.plan is plan]
        found = evidence_near(plan.evidence, moments, _EVIDENCE_NEAR_NS)
        known |= {(plan.name, at): what for at, what in zip(moments, found, strict=True)}
    for one in placed:
        if one.assignment.split is None:
            continue
        evidence_here = known[one.plan.name, one.key_ns]
        usable = [(t, i) for t, i in _images(one, journal) if i.written is not None]
        for topic, image in usable:
            candidates.append(
                Candidate(
                    drive=one.plan.name,
                    camera=one.plan.streams[topic].name,
                    stamp_ns=image.stamp_ns,
                    keyframe_ns=one.key_ns,
                    look=image.written.look if image.written is not None else None,
                    evidence=evidence_here,
                )
            )
            owners.append(one)
        if not one.moment.images and _has_points(one, journal):
            candidates.append(
                Candidate(
                    drive=one.plan.name,
                    camera="",
                    stamp_ns=one.key_ns,
                    keyframe_ns=one.key_ns,
                    look=None,
                    evidence=evidence_here,
                )
            )
            owners.append(one)
    return candidates, owners


def _has_points(one: PlacedMoment, journal: Journal) -> bool:
    scan = journal.scans.get((one.plan.name, one.key_ns))
    return scan is not None and scan.points > 0


def _file_of(candidate: Candidate, owner: PlacedMoment, journal: Journal) -> str:
    if not candidate.camera:
        return ""
    topic = owner.topic_of(candidate.camera)
    written = journal.images[owner.plan.name, topic, candidate.stamp_ns].written
    return "" if written is None else written.file


def _dropped(
    folder: Path, one: PlacedMoment, camera: str, stamp_ns: int, reason: str, of: str = ""
) -> DroppedFrame:
    stem = f"{one.plan.name}_{safe_name(camera)}_{stamp_ns}"
    files = (folder / f"images/{stem}{suffix}" for suffix in (".jpg", ".png"))
    return DroppedFrame(
        log=one.plan.log,
        drive=one.plan.name,
        camera=camera,
        stamp_ns=stamp_ns,
        reason=reason,
        of=of,
        picture=next((file for file in files if file.is_file()), None),
        latitude=one.latitude,
        longitude=one.longitude,
    )


def _never_candidates(
    folder: Path, placed: Sequence[PlacedMoment], journal: Journal
) -> Iterator[DroppedFrame]:
    """Yield the images that no part takes, and those that could not be used."""
    for one in placed:
        names = {topic: one.plan.streams[topic].name for topic in one.moment.images}
        if one.assignment.split is None:
            for topic, stamp_ns in one.moment.images.items():
                yield _dropped(folder, one, names[topic], stamp_ns, one.assignment.reason)
            continue
        for topic, image in _images(one, journal):
            if image.written is None:
                yield _dropped(folder, one, names[topic], image.stamp_ns, image.failure)


def _kept_by_moment(
    candidates: Sequence[Candidate], owners: Sequence[PlacedMoment], decisions: Sequence[Decision]
) -> dict[tuple[str, int], list[str]]:
    """Return the cameras of each keyframe that stays."""
    kept: dict[tuple[str, int], list[str]] = {}
    for candidate, owner, decision in zip(candidates, owners, decisions, strict=True):
        if decision.dropped is None:
            kept.setdefault((owner.plan.name, owner.key_ns), []).append(candidate.camera)
    return kept
