"""The report of `percept dataset diff`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from percept.core.results import Verdict
from percept.datasets.labelling.corrections.compare import SetDiff
from percept.datasets.labelling.corrections.diff_figures import Change, ClassFigures
from percept.export.detection_report import closing_sections
from percept.export.label_diff_pictures import MOST_PICTURES, change_pictures
from percept.export.report import Block, Paragraph, ReportContent, Section, Table

__all__ = ["label_diff_report"]

_KINDS = {
    Change.REMOVED: "Removed: A has them, B does not",
    Change.ADDED: "Added: B has them, A does not",
    Change.RELABELLED: "Relabelled: the class is another",
    Change.MOVED: "Moved: the class stayed, the sides did not",
}
_HAPPENED = {
    "boxes_a": "in A", "boxes_b": "in B", "unchanged": "unchanged", "moved": "moved",
    "relabelled": "relabelled", "removed": "removed", "added": "added",
}  # fmt: skip
_SCORES = {
    "precision": "precision of A",
    "recall": "recall of A",
    "mean_iou_of_moved": "mean IoU of moved",
}


def label_diff_report(
    diff: SetDiff,
    *,
    folders: tuple[Path, Path],
    verdict: Verdict,
    why: Sequence[str],
    inputs: Sequence[Mapping[str, object]],
    settings: Mapping[str, object],
) -> ReportContent:
    """Return the report of a comparison.

    Args:
        diff: What differs.
        folders: Those of A and B; images are looked for in both.
        verdict: How far the figures can be trusted.
        why: Reasons for the verdict.
        inputs: The files that were read: `path` and `bytes`.
        settings: When boxes count as the same.
    """
    changed = sum(n for kind, n in diff.total.counts.items() if kind is not Change.UNCHANGED)
    return ReportContent(
        title="What changed between two labellings",
        verdict=verdict,
        why=tuple(why),
        advice=(),
        sections=(
            Section("By class", _figures(diff.by_class, diff.total)),
            Section("A held against B", _scores(diff.by_class, diff.total)),
            *_solid_sections(diff),
            *_picture_sections(diff, folders),
            *closing_sections(
                dropped=diff.dropped, inputs=inputs, notes=diff.notes, settings=settings
            ),
        ),
        subtitle=f"A: {folders[0]}; B: {folders[1]}; {len(diff.images):,} images, "
        f"{changed:,} changes of 2D boxes",
    )


def _scores(by_class: Mapping[str, ClassFigures], total: ClassFigures) -> tuple[Block, ...]:
    text = (
        "Precision is the share of A's boxes that B has with the same class and enough overlap, "
        "recall the share of B's that A had: where A is what a detector found and B what people "
        "made of it, these are the detector's."
    )
    return Paragraph(text), _table(_SCORES, by_class, total)


def _figures(by_class: Mapping[str, ClassFigures], total: ClassFigures) -> tuple[Block, ...]:
    return (_table(_HAPPENED, by_class, total),)


def _table(
    columns: Mapping[str, str], by_class: Mapping[str, ClassFigures], total: ClassFigures
) -> Table:
    rows = [*by_class.items(), ("all classes", total)]
    cells = ((name, *(_cell(figures.document()[key]) for key in columns)) for name, figures in rows)
    return Table(("class", *columns.values()), tuple(cells))


def _cell(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"


def _solid_sections(diff: SetDiff) -> Iterator[Section]:
    if diff.has_solid_changes:
        of = diff.solids_by_class, diff.solids_total
        yield Section("3D boxes", (*_figures(*of), *_scores(*of)))
    elif diff.moments:
        text = "No 3D box differs. Of the formats only KITTI brings 3D boxes back."
        yield Section("3D boxes", (Paragraph(text),))


def _picture_sections(diff: SetDiff, folders: tuple[Path, Path]) -> Iterator[Section]:
    for kind, title in _KINDS.items():
        blocks, count = change_pictures(diff, folders, kind)
        if blocks:
            shown = f"{MOST_PICTURES} of {count:,}" if count > MOST_PICTURES else f"all {count}"
            note = Paragraph(f"Shown: {shown}. Orange is A, light blue is B.")
            yield Section(title, (note, *blocks))
