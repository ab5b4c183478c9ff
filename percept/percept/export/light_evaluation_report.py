"""The report of `percept eval lights`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from percept.evaluation.lights import LightCounts, LightScores
from percept.export.detection_report import installed_versions
from percept.export.report import Block, Paragraph, ReportContent, Section, Table

__all__ = ["light_scores_report"]

_FIGURES = {
    "moments": "moments", "state_accuracy": "right", "known_accuracy": "right where known",
    "unknown_rate": "unknown", "wrong": "wrong", "red_as_green": "red read as green",
    "at_a_change": "at a change",
}  # fmt: skip
_TIMES = {
    "changes": "changes", "changes_missed": "never shown", "delay_median_s": "delay, s",
    "delay_p95_s": "delay (95 %), s", "flashing_lights": "flashing lights",
    "flash_missed": "never found", "flash_delay_median_s": "found after, s",
    "flash_delay_p95_s": "found after (95 %), s", "steady_lights": "steady lights",
    "falsely_flashing_lights": "said to flash",
}  # fmt: skip


def light_scores_report(
    scores: LightScores, *, inputs: Sequence[Mapping[str, object]]
) -> ReportContent:
    """Return the report of a scoring of traffic lights.

    Args:
        scores: The scores.
        inputs: The files that were read: `path` and `bytes`.
    """
    rows = {"all": scores.total}
    rows |= {str(light): one for light, one in sorted(scores.by_light.items())}
    files = Table(
        ("file", "bytes"), tuple((str(one["path"]), f"{one['bytes']:,}") for one in inputs)
    )
    versions = Table(
        ("name", "version"), tuple((name, str(v)) for name, v in installed_versions().items())
    )
    total = scores.total
    return ReportContent(
        title="Traffic lights against labels",
        verdict=scores.verdict,
        why=scores.why,
        advice=(),
        sections=(
            Section("States", (_table(rows, _FIGURES),)),
            Section("Changes and flashing", (_table(rows, _TIMES),)),
            Section("What was left out", (_left_out(scores.dropped),)),
            Section("Inputs", (files,)),
            Section("Versions", (versions,)),
        ),
        subtitle=(
            f"{len(scores.by_light):,} lights, {total.moments:,} moments at which a camera sees "
            f"one, {total.red_as_green:,} red read as green"
        ),
    )


def _table(rows: Mapping[str, LightCounts], names: Mapping[str, str]) -> Table:
    cells = (
        (name, *(_cell(counts.document()[key]) for key in names)) for name, counts in rows.items()
    )
    return Table(("light", *names.values()), tuple(cells))


def _cell(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:,}" if isinstance(value, int) else f"{value:.3f}"


def _left_out(dropped: Mapping[str, int]) -> Block:
    if not dropped:
        return Paragraph("Nothing was left out.")
    return Table(("what", "count"), tuple((what, f"{n:,}") for what, n in dropped.items()))
