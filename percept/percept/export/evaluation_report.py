"""The report of `percept eval detections`: how good a detector is, and where it is not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from percept.core.results import Verdict
from percept.evaluation.boxes_2d.result import AveragePrecision, BoxScores, Counts
from percept.export.charts import share_curves
from percept.export.detection_report import installed_versions
from percept.export.report import Block, Paragraph, ReportContent, Section, Table, svg_picture

__all__ = ["box_scores_report"]

_AVERAGES = ("AP50", "AP75", "AP", "AR")
_COUNTS = ("objects", "detections", "found", "precision", "recall", "F1")
_MOST_CURVES = 12
_MOST_CONFUSIONS = 20


def box_scores_report(
    scores: BoxScores,
    *,
    inputs: Sequence[Mapping[str, object]],
    files: int,
    settings: Mapping[str, object],
) -> ReportContent:
    """Return the report of a scoring.

    Args:
        scores: The scores.
        inputs: The first files that were read: `path`, `bytes` and what else is known of them.
        files: How many files were read.
        settings: The resolved configuration.
    """
    sections = (
        Section("Precision and recall", tuple(_curves(scores))),
        Section("By class", tuple(_classes(scores))),
        Section("By size of the box", tuple(_sizes(scores))),
        Section("By distance", tuple(_ranges(scores))),
        Section("What goes wrong", tuple(_mistakes(scores))),
        Section("Images with the most mistakes", tuple(_worst(scores))),
        Section("What was left out", (_left_out(scores), *map(Paragraph, scores.notes))),
        Section("Inputs", tuple(_inputs(inputs, files))),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
    )
    return ReportContent(
        title="2D detections against labels",
        verdict=scores.verdict,
        why=scores.why,
        advice=_advice(scores),
        sections=tuple(section for section in sections if section.blocks),
        subtitle=(
            f"{scores.images:,} images, {scores.counts.objects:,} objects, AP50 "
            f"{_share(scores.average.ap50)}, AP {_share(scores.average.ap)}"
        ),
    )


def _advice(scores: BoxScores) -> tuple[str, ...]:
    if scores.verdict is Verdict.GOOD:
        return ()
    advice = ["Read the figures with the reasons above: they judge the figures, not the detector."]
    if any("--map" in reason for reason in scores.why):
        advice.append("Say with --map which classes are the same.")
    return tuple(advice)


def _curves(scores: BoxScores) -> Iterator[Block]:
    most = sorted(scores.classes, key=lambda one: -one.counts.objects)[:_MOST_CURVES]
    shown = [one for one in most if one.counts.objects]
    if not shown:
        return
    recalls = [k / 100 for k in range(101)]
    curves = {one.label: (recalls, one.precision_at_recall.tolist()) for one in shown}
    title = "Precision at each recall, IoU 0.50"
    svg = share_curves(title, "recall", "precision", curves)
    names = ", ".join(curves)
    yield svg_picture(svg, f"Precision against recall of {names}", "The area below is AP50.")


def _classes(scores: BoxScores) -> Iterator[Block]:
    low, high = scores.ap50_interval
    if math.isfinite(low):
        yield Paragraph(
            f"Mean AP50 {scores.average.ap50:.3f}. Other images of the same kind would give "
            f"{low:.3f} to {high:.3f} (90 %, images drawn anew with replacement). Images that "
            "follow each other in a drive resemble each other: over several drives it is wider."
        )
    rows = [
        (
            one.label,
            *_average(one.average),
            *_count(one.counts),
            _share(one.best_f1),
            _share(one.best_score),
        )
        for one in scores.classes
    ]
    rows.append(("all", *_average(scores.average), *_count(scores.counts), "", ""))
    yield Table(
        ("class", *_AVERAGES, *_COUNTS, "best F1", "at confidence"),
        tuple(rows),
        f"Counts at a confidence of {scores.score:g} and an IoU of {scores.iou:g}; AP by the rules "
        "of COCO, over all confidences.",
    )


def _sizes(scores: BoxScores) -> Iterator[Block]:
    if scores.by_size:
        rows = tuple(
            (name, *_average(average), *_count(counts))
            for name, (average, counts) in scores.by_size.items()
        )
        caption = "small: up to 32 x 32 pixels; medium: up to 96 x 96, by the area of the box."
        yield Table(("size", *_AVERAGES, *_COUNTS), rows, caption)
        yield _bands("height", scores.by_height)


def _ranges(scores: BoxScores) -> Iterator[Block]:
    if scores.by_range:
        yield _bands("distance", scores.by_range)
        yield Paragraph(
            "A detection that is no object stands at its own distance, or under unknown where no "
            "sensor measured it."
        )


def _bands(name: str, bands: Mapping[str, Counts]) -> Table:
    return Table((name, *_COUNTS), tuple((band, *_count(n)) for band, n in bands.items()))


def _mistakes(scores: BoxScores) -> Iterator[Block]:
    missed = scores.counts.objects - scores.counts.hits
    rows = [(f"false: {kind}", f"{count:,}") for kind, count in scores.mistakes.items()]
    yield Table(("mistake", "count"), (("object not found", f"{missed:,}"), *rows))
    if scores.confusions:
        yield Table(
            ("object", "taken for", "count"),
            tuple((a, b, f"{n:,}") for a, b, n in scores.confusions[:_MOST_CONFUSIONS]),
        )


def _worst(scores: BoxScores) -> Iterator[Block]:
    if scores.worst:
        rows = tuple(
            (one.name, f"{one.objects:,}", f"{one.missed:,}", f"{one.false:,}")
            for one in scores.worst
        )
        yield Table(("image", "objects", "not found", "false"), rows)


def _left_out(scores: BoxScores) -> Block:
    if not scores.dropped:
        return Paragraph("Nothing was left out.")
    rows = tuple((reason, f"{count:,}") for reason, count in scores.dropped.items())
    return Table(("what", "count"), rows)


def _inputs(inputs: Sequence[Mapping[str, object]], files: int) -> Iterator[Block]:
    rows = tuple((str(entry["path"]), f"{entry['bytes']:,}") for entry in inputs)
    yield Table(("file", "bytes"), rows)
    if files > len(inputs):
        yield Paragraph(f"And {files - len(inputs):,} more; run.json names all.")


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))


def _average(average: AveragePrecision) -> tuple[str, ...]:
    return tuple(_share(v) for v in (average.ap50, average.ap75, average.ap, average.ar))


def _count(counts: Counts) -> tuple[str, ...]:
    numbers = (counts.objects, counts.detections, counts.hits)
    shares = (counts.precision, counts.recall, counts.f1)
    return (*("" if n is None else f"{n:,}" for n in numbers), *(_share(v) for v in shares))


def _share(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else ""
