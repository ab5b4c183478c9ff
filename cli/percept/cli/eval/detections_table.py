"""What `percept eval detections` prints for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import typer

from percept.evaluation.boxes_2d import AveragePrecision, BoxScores, Counts

__all__ = ["show_scores"]

_HEADER = ("objects", "AP50", "AP75", "AP", "AR", "detections", "precision", "recall", "F1")
_MOST_CONFUSIONS = 5


def show_scores(scores: BoxScores, out: Path | None) -> None:
    """Print the scores by class, size and distance, the verdict with its reasons, and notes.

    Args:
        scores: The scores.
        out: The run folder, where there is one.
    """
    typer.echo(
        f"{scores.images} images; detections, precision, recall and F1 at a confidence of "
        f"{scores.score:g} and an IoU of {scores.iou:g}"
    )
    _print(_table(scores))
    low, high = scores.ap50_interval
    if math.isfinite(low):
        typer.echo(f"AP50 {scores.average.ap50:.3f}, 90 % interval {low:.3f} to {high:.3f}")
    for kind, count in scores.mistakes.items():
        typer.echo(f"{count} false: {kind}")
    for truth, detected, count in scores.confusions[:_MOST_CONFUSIONS]:
        typer.echo(f"  {count} {truth} taken for {detected}")
    for reason, count in scores.dropped.items():
        typer.echo(f"left out: {count} {reason}")
    for note in scores.notes:
        typer.echo(f"note: {note}")
    typer.echo(f"verdict: {scores.verdict}")
    for reason in scores.why:
        typer.echo(f"  - {reason}")
    if out is not None:
        typer.echo(f"look at it: {out / 'report.html'}")


def _table(scores: BoxScores) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("class", *_HEADER, "best F1")]
    for one in scores.classes:
        best = f"{_share(one.best_f1)} at {_share(one.best_score)}"
        rows.append((one.label, *_cells(one.average, one.counts), best))
    rows.append(("all", *_cells(scores.average, scores.counts), ""))
    rows += [
        (name, *_cells(average, counts), "") for name, (average, counts) in scores.by_size.items()
    ]
    for bands in (scores.by_height, scores.by_range):
        rows += _bands(bands)
    return rows


def _bands(bands: Mapping[str, Counts]) -> Iterable[tuple[str, ...]]:
    for band, counts in bands.items():
        yield (band, *_cells(None, counts), "")


def _cells(average: AveragePrecision | None, counts: Counts) -> tuple[str, ...]:
    shares = (
        ("",) * 4
        if average is None
        else tuple(_share(v) for v in (average.ap50, average.ap75, average.ap, average.ar))
    )
    return (
        str(counts.objects),
        *shares,
        "-" if counts.detections is None else str(counts.detections),
        *(_share(v) for v in (counts.precision, counts.recall, counts.f1)),
    )


def _share(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"


def _print(rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        first = row[0].ljust(widths[0])
        rest = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        typer.echo("  ".join((first, *rest)).rstrip())
