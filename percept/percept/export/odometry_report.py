"""The report of `percept odometry`: where the vehicle was, and how well that is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.export.charts import timeline
from percept.export.odometry_picture import way_picture
from percept.export.report import Block, Paragraph, ReportContent, Section, Table, svg_picture

__all__ = ["DriftRow", "OdometryEvidence", "odometry_report"]

_MOST_ROWS = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftRow:
    """How far the poses are from those of something else.

    Attributes:
        against: What they are compared with.
        figures: By name with its unit, the value.
    """

    against: str
    figures: Mapping[str, str]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class OdometryEvidence:
    """What the report shows.

    Attributes:
        source: What the poses were made from.
        ways: By source, trajectories in the frame of the first one, whose report this is.
        facts: What was done, by name.
        seconds: (N,) time of each value below from the first one on.
        over_time: By name with its unit, N values; NaN where there is none.
        drift: Comparisons with other poses.
        gaps: Start and length in seconds of each gap and jump.
        failures: Scans that have no pose: number, time in seconds, reason.
        dropped: What was not used, by reason.
        notes: What a user should know besides.
        inputs: Files, as `describe_input` tells them.
    """

    source: str
    ways: Mapping[str, Trajectory]
    facts: Mapping[str, str]
    seconds: Sequence[float] = ()
    over_time: Mapping[str, Sequence[float]] = field(default_factory=dict)
    drift: Sequence[DriftRow] = ()
    gaps: Sequence[tuple[float, float]] = ()
    failures: Sequence[tuple[int, float, str]] = ()
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: Sequence[str] = ()
    inputs: Sequence[Mapping[str, object]] = ()


def odometry_report(
    evidence: OdometryEvidence, *, verdict: Verdict, why: Sequence[str], advice: Sequence[str]
) -> ReportContent:
    """Return the report.

    Args:
        evidence: What it shows.
        verdict: How far the poses can be trusted.
        why: Reasons for it.
        advice: What to do about it.
    """
    sections = [
        Section("The way", _way(evidence)),
        Section("How well the poses are known", _quality(evidence)),
    ]
    if evidence.drift:
        sections.append(Section("Drift", _drift(evidence.drift)))
    sections.append(Section("Gaps and what was left out", _breaks(evidence)))
    sections.append(Section("What was read", _inputs(evidence)))
    return ReportContent(
        title=f"Where the vehicle was, by {evidence.source}",
        verdict=verdict,
        why=tuple(why),
        advice=tuple(advice),
        sections=tuple(sections),
    )


def _way(evidence: OdometryEvidence) -> tuple[Block, ...]:
    caption = (
        "From above. The ring is the beginning; nothing is drawn through gaps and jumps, whose "
        "ends are red. The other sources are laid over the first one as well as they fit."
    )
    drawn = way_picture("The way from above", evidence.ways)
    facts = Table(("what", "value"), tuple(evidence.facts.items()))
    return (svg_picture(drawn, "The ways of all sources from above", caption), facts)


def _quality(evidence: OdometryEvidence) -> tuple[Block, ...]:
    if not evidence.over_time:
        return (Paragraph("The source does not tell how well its poses are known."),)
    chart = timeline("Over the drive", evidence.seconds, evidence.over_time)
    return (svg_picture(chart, "Spread and fit over time"),)


def _drift(rows: Sequence[DriftRow]) -> tuple[Block, ...]:
    names = tuple(dict.fromkeys(name for row in rows for name in row.figures))
    cells = tuple((row.against, *(row.figures.get(name, "-") for name in names)) for row in rows)
    table = Table(("against", *names), cells)
    words = (
        "Errors of stretches are means over all of them, as in the KITTI benchmark. The absolute "
        "error is that after the best rotation and shift; fixes of GNSS have an error of their own."
    )
    return (table, Paragraph(words))


def _breaks(evidence: OdometryEvidence) -> tuple[Block, ...]:
    blocks: list[Block] = []
    if evidence.gaps:
        rows = tuple((f"{at:.3f}", f"{long:.3f}") for at, long in evidence.gaps[:_MOST_ROWS])
        blocks.append(
            Table(("from (s)", "length (s)"), rows, _more("Gaps and jumps", evidence.gaps))
        )
    if evidence.failures:
        failed = tuple(
            (str(scan), f"{at:.3f}", why) for scan, at, why in evidence.failures[:_MOST_ROWS]
        )
        caption = _more("Scans that did not register", evidence.failures)
        blocks.append(Table(("scan", "at (s)", "why"), failed, caption))
    if evidence.dropped:
        left_out = tuple((reason, str(count)) for reason, count in evidence.dropped.items())
        blocks.append(Table(("left out", "count"), left_out))
    return tuple(blocks) or (Paragraph("There is no gap, and nothing was left out."),)


def _more(title: str, rows: Sequence[object]) -> str:
    return title if len(rows) <= _MOST_ROWS else f"{title}: the first {_MOST_ROWS} of {len(rows)}"


def _inputs(evidence: OdometryEvidence) -> tuple[Block, ...]:
    rows = tuple((str(i["path"]), str(i["bytes"])) for i in evidence.inputs)
    return (Table(("file", "bytes"), rows), *(Paragraph(note) for note in evidence.notes))
