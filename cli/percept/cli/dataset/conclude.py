"""The end of a preparation: what the set is worth, its card and report, and its folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percept.cli.dataset.assemble import Assembled
from percept.cli.dataset.calibration import calibration_of
from percept.cli.dataset.drives import DrivePlan
from percept.cli.dataset.journal import JOURNAL_NAME, PLAN_NAME
from percept.cli.dataset.request import PrepareConfig, PrepareRequest
from percept.cli.dataset.write_formats import WrittenFormats
from percept.cli.run_folder import RunFolder, describe_input
from percept.core.results import Verdict
from percept.datasets.labelling.card import write_card
from percept.datasets.labelling.dropped import drop_counts
from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet
from percept.datasets.labelling.places.split import SplitReason

__all__ = ["Prepared", "conclude"]

_NOT_LOOKED_AT: tuple[SplitReason, ...] = ("margin", "place_unknown")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prepared:
    """All that a preparation made.

    Attributes:
        request: What was asked for.
        config: Settings.
        plans: The logs.
        labelled: The set, in a hidden folder.
        assembled: What it was made of.
        written: Its formats.
        inputs: Files that were read.
        blurred: Regions that were made unreadable, by kind.
        losses: What else was left out, by reason.
        notes: What a user should know besides, as sentences.
    """

    request: PrepareRequest
    config: PrepareConfig
    plans: Sequence[DrivePlan]
    labelled: LabelledSet
    assembled: Assembled
    written: WrittenFormats
    inputs: Sequence[Path]
    blurred: Mapping[str, int]
    losses: Counter[str]
    notes: Sequence[str]


def conclude(folder: RunFolder, prepared: Prepared) -> dict[str, Any]:
    """Judge, write card and report, move all out of the hidden folder, and end the run.

    Returns:
        The content of `run.json`.
    """
    from percept.export.dataset_report import dataset_report
    from percept.export.report import write_report

    labelled, assembled = prepared.labelled, prepared.assembled
    config = {
        **prepared.config.model_dump(mode="json"),
        "formats": list(prepared.request.formats),
        "logs": {plan.name: plan.log for plan in prepared.plans},
    }
    judged = _judge(
        labelled,
        assembled,
        prepared.written.refused,
        sum(plan.images for plan in prepared.plans),
        prepared.config,
    )
    refused = [f"{name} is not written: {why}" for name, why in prepared.written.refused.items()]
    notes = [*prepared.notes, *_notes(prepared.plans), *refused]
    others = {reason: count for reason, count in prepared.losses.items() if count}
    inputs = [path for path in prepared.inputs if path.is_file()]
    write_card(
        labelled,
        dropped=drop_counts(assembled.dropped),
        losses=prepared.written.losses,
        settings=config,
        margin_m=prepared.config.split.margin_m,
        blurred=prepared.blurred,
        calibration={
            plan.name: calibration_of(plan, prepared.request.rig) for plan in prepared.plans
        },
        notes=[*notes, *(f"Left out besides: {count} x {what}." for what, count in others.items())],
    )
    report = dataset_report(
        labelled,
        assembled.dropped,
        verdict=judged.verdict,
        why=judged.why,
        advice=judged.advice,
        losses=prepared.written.losses,
        others=others,
        inputs=[describe_input(path) for path in inputs],
        settings=config,
        notes=notes,
    )
    write_report(labelled.folder / "report.html", report)
    # From here on there is no going on: who finds a hidden folder without a plan begins anew.
    (labelled.folder / PLAN_NAME).unlink()
    _remove_dropped(labelled)
    _move_out(labelled.folder, folder.path)
    document = folder.finish(
        config=config,
        inputs=inputs,
        counts={
            **judged.counts,
            **({"blurred": dict(prepared.blurred)} if prepared.blurred else {}),
        },
        dropped={**drop_counts(assembled.dropped), **others},
        verdict=judged.verdict,
        why=judged.why,
        notes=notes,
    )
    labelled.folder.rmdir()  # last, so that whoever resumes knows whose files these are
    return document


def _remove_dropped(labelled: LabelledSet) -> None:
    """Remove the files of images and scans that are not in the set."""
    kept: set[str | None] = set()
    for keyframe in labelled.keyframes:
        kept |= {keyframe.scan.file} if keyframe.scan is not None else set()
        for frame in keyframe.frames:
            kept |= {frame.file, frame.rectified_file}
    for name in ("images", "rectified", "scans"):
        folder = labelled.folder / name
        for path in folder.iterdir():
            if f"{name}/{path.name}" not in kept:
                path.unlink()
        if not any(folder.iterdir()):
            folder.rmdir()


def _move_out(staging: Path, out: Path) -> None:
    """Give what was made its place."""
    (staging / JOURNAL_NAME).unlink()
    for path in sorted(staging.iterdir()):
        path.rename(out / path.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Judged:
    """How far a set can be used.

    Attributes:
        verdict: The verdict.
        why: Reasons for it.
        advice: What would help.
        counts: What is in the set, in numbers.
    """

    verdict: Verdict
    why: tuple[str, ...]
    advice: tuple[str, ...]
    counts: dict[str, Any]


def _judge(
    labelled: LabelledSet,
    assembled: Assembled,
    refused: Mapping[str, str],
    images_in_logs: int,
    config: PrepareConfig,
) -> _Judged:
    """Judge a set.

    Args:
        labelled: The set.
        assembled: What it was made of.
        refused: By format, why it was not written.
        images_in_logs: Images of the cameras in the logs.
        config: Settings.
    """
    images = Counter(keyframe.split for keyframe, _ in labelled.frames())
    keyframes = Counter(keyframe.split for keyframe in labelled.keyframes)
    counts = {
        "drives": len(labelled.drives),
        "keyframes": len(labelled.keyframes),
        "images": sum(images.values()),
        "scans": sum(one.scan is not None for one in labelled.keyframes),
        "boxes_2d": sum(len(frame.boxes) for _, frame in labelled.frames()),
        "boxes_3d": sum(len(one.solids) for one in labelled.keyframes),
        "classes": len(labelled.categories),
        "images_in_logs": images_in_logs,
        "images_looked_at": sum(images.values())
        + sum(one.reason not in _NOT_LOOKED_AT for one in assembled.dropped),
        "images_by_split": {name: images[name] for name in SPLITS},
    }
    if not labelled.keyframes:
        return _Judged(
            verdict=Verdict.BAD,
            why=("nothing is left to label: all images were left out",),
            advice=("look in dropped.parquet and report.html for the reasons",),
            counts=counts,
        )
    doubts, advice = [], []
    for name, why in refused.items():
        doubts.append(f"{name} could not be written")
        advice.append(f"{name}: {why}")
    shares = {"train": config.split.train, "val": config.split.val, "test": config.split.test}
    empty = [name for name in SPLITS if shares[name] > 0 and not keyframes[name]]
    if empty:
        doubts.append(f"{' and '.join(empty)} {'is' if len(empty) == 1 else 'are'} empty")
        advice.append(
            "add drives in other places: whole cells of the ground go to one part; --cell makes "
            "them smaller"
        )
    if doubts:
        return _Judged(
            verdict=Verdict.DOUBTFUL, why=tuple(doubts), advice=tuple(advice), counts=counts
        )
    return _Judged(
        verdict=Verdict.GOOD,
        why=("all formats were written, and no part is empty",),
        advice=(),
        counts=counts,
    )


def _notes(plans: Sequence[DrivePlan]) -> list[str]:
    """Return the notes of all logs; what is true of each is said once."""
    names: dict[str, list[str]] = {}
    for plan in plans:
        for note in dict.fromkeys(plan.notes):
            names.setdefault(note, []).append(plan.name)
    return [
        note if len(said) == len(plans) else f"{', '.join(said)}: {note}"
        for note, said in names.items()
    ]
