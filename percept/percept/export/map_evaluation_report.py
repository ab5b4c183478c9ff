"""The report of `percept eval map`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from percept.evaluation.map_findings import MapScores, PlacedFinding
from percept.export.detection_report import closing_sections
from percept.export.report import Block, Paragraph, ReportContent, Section, Table

__all__ = ["map_scores_report"]

_FIGURES = {
    "planted": "planted", "found": "found", "missed": "missed", "false": "false",
    "precision": "precision", "recall": "recall", "f1": "F1",
    "offset_error_m": "mean error of the offset, m",
}  # fmt: skip


def map_scores_report(
    scores: MapScores, *, inputs: Sequence[Mapping[str, object]]
) -> ReportContent:
    """Return the report of a scoring of findings about a map.

    Args:
        scores: The scores.
        inputs: The files that were read: `path` and `bytes`.
    """
    total, rate = scores.total, scores.false_per_km
    a_km = "" if rate is None else f", {rate:.2f} a km"
    return ReportContent(
        title="Findings about a map against planted changes",
        verdict=scores.verdict,
        why=scores.why,
        advice=(),
        sections=(
            Section("By kind", (_figures(scores),)),
            Section("Missed changes", (_places(scores.missed),)),
            Section("False findings", (_places(scores.false),)),
            *closing_sections(dropped=scores.dropped, inputs=inputs, notes=(), settings={}),
        ),
        subtitle=f"{total.found} of {total.planted} changes found, {total.false} false{a_km}",
    )


def _figures(scores: MapScores) -> Table:
    rows = {str(kind): one.document() for kind, one in scores.by_kind.items()}
    rows["all"] = scores.total.document()
    cells = ((name, *(_cell(row[key]) for key in _FIGURES)) for name, row in rows.items())
    return Table(("kind", *_FIGURES.values()), tuple(cells))


def _cell(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"


def _places(findings: Sequence[PlacedFinding]) -> Block:
    if not findings:
        return Paragraph("There are none.")
    rows = [
        (
            one.finding_id,
            str(one.kind),
            str(one.map_element_id),
            *map("{:.2f}".format, one.middle_m),
        )
        for one in findings
    ]
    return Table(("finding", "kind", "map element", "x, m", "y, m"), tuple(rows))
