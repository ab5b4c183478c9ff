"""What happened to boxes from one labelling to another, counted by class."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["BoxChange", "Change", "ClassFigures", "figures_of"]


class Change(StrEnum):
    """What happened to a box from A to B; one of another class is relabelled, moved or not."""

    UNCHANGED = "unchanged"
    MOVED = "moved"
    RELABELLED = "relabelled"
    ADDED = "added"
    REMOVED = "removed"


@dataclass(frozen=True, slots=True)
class BoxChange:
    """One box.

    Attributes:
        change: What happened.
        row_a: Its row among the boxes of A; None where it was added.
        row_b: Its row among those of B; None where it was removed.
        iou: Overlap of both; of 3D boxes that from above; NaN for one alone.
        shift: How far sides moved at most, in px; of 3D boxes centre, size or ends in m.
    """

    change: Change
    row_a: int | None
    row_b: int | None
    iou: float
    shift: float


@dataclass(slots=True)
class ClassFigures:
    """What happened to the boxes of a class.

    Attributes:
        in_a: Boxes that A has.
        in_b: Boxes that B has.
        counts: How many of A's are unchanged, moved, relabelled or removed, and how many of B's
            are added.
        became: How many of B's had another class in A.
        right: Pairs of one class that overlap enough.
        moved_iou: Sum of the overlaps of those that moved.
    """

    in_a: int = 0
    in_b: int = 0
    counts: Counter[Change] = field(default_factory=Counter)
    became: int = 0
    right: int = 0
    moved_iou: float = 0.0

    @property
    def precision(self) -> float | None:
        """Share of A's boxes that B has too; None without any."""
        return self.right / self.in_a if self.in_a else None

    @property
    def recall(self) -> float | None:
        """Share of B's boxes that A had; None without any."""
        return self.right / self.in_b if self.in_b else None

    @property
    def mean_moved_iou(self) -> float | None:
        """Mean overlap of the boxes that moved; None where none did."""
        moved = self.counts[Change.MOVED]
        return self.moved_iou / moved if moved else None

    def document(self) -> dict[str, float | None]:
        """Return all figures for JSON."""
        return {
            "boxes_a": self.in_a,
            "boxes_b": self.in_b,
            **{str(change): self.counts[change] for change in Change},
            "relabelled_to": self.became,
            "precision": self.precision,
            "recall": self.recall,
            "mean_iou_of_moved": self.mean_moved_iou,
        }


def figures_of(
    compared: Iterable[tuple[Sequence[str], Sequence[str], Sequence[BoxChange]]],
    order: Sequence[str],
    least_iou: float,
) -> tuple[dict[str, ClassFigures], ClassFigures]:
    """Return the figures by class, of those that there are, and of all classes together.

    Args:
        compared: Class names of A, those of B, and what happened, image by image.
        order: All class names.
        least_iou: From which a box of A with the right class is right.
    """
    by_class: dict[str, ClassFigures] = {label: ClassFigures() for label in order}
    for a, b, changes in compared:
        for change in changes:
            before = None if change.row_a is None else a[change.row_a]
            after = None if change.row_b is None else b[change.row_b]
            _count(by_class, change, (before, after), least_iou)
    total = ClassFigures()
    for one in by_class.values():
        total.in_a += one.in_a
        total.in_b += one.in_b
        total.counts += one.counts
        total.became += one.became
        total.right += one.right
        total.moved_iou += one.moved_iou
    return {label: one for label, one in by_class.items() if one.in_a or one.in_b}, total


def _count(
    by_class: dict[str, ClassFigures],
    change: BoxChange,
    labels: tuple[str | None, str | None],
    least_iou: float,
) -> None:
    before, after = labels
    if before is not None:
        by_class[before].in_a += 1
    if after is not None:
        by_class[after].in_b += 1
    of = before if before is not None else after
    if of is None:
        return
    figures = by_class[of]
    figures.counts[change.change] += 1
    if change.change is Change.MOVED:
        figures.moved_iou += change.iou
    if change.change is Change.RELABELLED and after is not None:
        by_class[after].became += 1
    elif before == after and change.iou >= least_iou:
        figures.right += 1
