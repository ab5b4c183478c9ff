"""The report of `percept eval tracks`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from percept.core.results import Verdict
from percept.export.charts import share_curves
from percept.export.detection_report import installed_versions
from percept.export.report import Block, Paragraph, ReportContent, Section, Table, svg_picture

__all__ = ["track_scores_report"]

_FIGURES = {
    "samota": "sAMOTA", "amota": "AMOTA", "amotp": "AMOTP", "mota": "MOTA", "motp": "MOTP",
    "hota": "HOTA", "det_a": "DetA", "ass_a": "AssA", "loc_a": "LocA", "idf1": "IDF1",
    "precision": "precision", "recall": "recall", "recall_any_label": "recall, any label",
    "velocity_rmse_mps": "velocity rmse, m/s",
}  # fmt: skip
_COUNTS = {
    "num_objects": "objects", "num_misses": "missed", "num_false_positives": "false",
    "num_switches": "switches", "switches_over_gaps": "switches over gaps",
    "num_fragmentations": "fragmentations", "mostly_tracked": "mostly tracked",
    "partially_tracked": "partially tracked", "mostly_lost": "mostly lost",
}  # fmt: skip
_Curves = Mapping[str, Sequence[tuple[float, float, float]]]


def track_scores_report(
    rows: Mapping[str, Mapping[str, float | None]],
    *,
    verdict: Verdict,
    why: Sequence[str],
    curves: _Curves,
    dropped: Mapping[str, int],
    notes: Sequence[str],
    inputs: Sequence[Mapping[str, object]],
    files: int,
    settings: Mapping[str, object],
) -> ReportContent:
    """Return the report of a scoring of tracks.

    Args:
        rows: Figures by name of the class, or of class and overlap.
        verdict: How far the figures can be trusted.
        why: Reasons for the verdict.
        curves: By the same names, recall, MOTA and scaled MOTA at each recall that is reached.
        dropped: What was left out, by reason.
        notes: What else a user should know.
        inputs: The first files that were read: `path`, `bytes` and what else is known of them.
        files: How many files were read.
        settings: The resolved configuration.
    """
    sections = (
        Section("Figures", (_table(rows, _FIGURES),)),
        Section("Counts", (_table(rows, _COUNTS),)),
        Section("Over recalls", tuple(_pictures(curves))),
        Section("What was left out", (_left_out(dropped), *map(Paragraph, notes))),
        Section("Inputs", tuple(_inputs(inputs, files))),
        Section("Settings and versions", (_named(settings), _named(dict(installed_versions())))),
    )
    return ReportContent(
        title="Tracks against labels",
        verdict=verdict,
        why=tuple(why),
        advice=(),
        sections=tuple(section for section in sections if section.blocks),
        subtitle=", ".join(rows),
    )


def _table(rows: Mapping[str, Mapping[str, float | None]], names: Mapping[str, str]) -> Table:
    keys = [key for key in names if any(key in figures for figures in rows.values())]
    cells = ((name, *(_cell(figures.get(key)) for key in keys)) for name, figures in rows.items())
    return Table(("", *(names[key] for key in keys)), tuple(cells))


def _cell(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,}" if isinstance(value, int) else f"{value:.4f}"


def _pictures(curves: _Curves) -> Iterator[Block]:
    shown = {name: points for name, points in curves.items() if points}
    if shown:
        lines = {
            name: ([recall for recall, *_ in points], [scaled for *_, scaled in points])
            for name, points in shown.items()
        }
        svg = share_curves("Scaled MOTA at each recall", "recall", "scaled MOTA", lines)
        text = "The mean over all 40 recalls is sAMOTA; a recall that is not reached counts as 0."
        yield svg_picture(svg, f"Scaled MOTA against recall of {', '.join(lines)}", text)


def _left_out(dropped: Mapping[str, int]) -> Block:
    if not dropped:
        return Paragraph("Nothing was left out.")
    return Table(("what", "count"), tuple((what, f"{n:,}") for what, n in dropped.items()))


def _inputs(inputs: Sequence[Mapping[str, object]], files: int) -> Iterator[Block]:
    yield Table(("file", "bytes"), tuple((str(one["path"]), f"{one['bytes']:,}") for one in inputs))
    if files > len(inputs):
        yield Paragraph(f"And {files - len(inputs):,} more; run.json names all.")


def _named(values: Mapping[str, object]) -> Table:
    return Table(("name", "value"), tuple((key, str(value)) for key, value in values.items()))
