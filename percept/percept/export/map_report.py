"""The report of `percept map validate`: where map and road disagree, and what was not seen."""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from percept.core.map_findings import Discrepancy, Status
from percept.core.results import Verdict
from percept.export.report import Block, Paragraph, Picture, ReportContent, Section, Table

__all__ = ["MapEvidence", "map_report"]

_MOST_ROWS = 200
_MOST_PICTURES = 12
_MEANINGS = {
    "missing_on_road": "the map has a line, the road does not",
    "missing_in_map": "the road has a line, the map does not",
    "moved": "the line lies elsewhere",
    "type": "solid, dashed or double, against what the map says",
    "colour": "white or yellow, against what the map says",
    "stop_line_missing": "the map has a stop line, the road does not",
    "stop_line_missing_in_map": "the road has a stop line, the map does not",
    "stop_line_moved": "the stop line lies elsewhere along the lane",
    "lane_width": "the lane is wider or narrower",
    "traffic_light_missing": "the map has a traffic light, the road does not",
    "traffic_light_missing_in_map": "the road has a traffic light, the map does not",
    "global_offset": "the whole map, or all poses, lie elsewhere",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class MapEvidence:
    """What the report shows.

    Attributes:
        map_name: Name of the map's file.
        findings: The surest first.
        pictures: By finding's id, the PNG file that shows it.
        facts: What was done, by name.
        not_seen_m: Metres of the map's lines along the way that were not seen, by reason.
        seen_m: Metres of them that were seen.
        offsets: How the poses lie against the map: rows of text by column.
        dropped: What was left out, by reason.
        notes: What a user should know besides.
        inputs: Files, as `describe_input` tells them.
    """

    map_name: str
    findings: Sequence[Discrepancy]
    pictures: Mapping[str, Path]
    facts: Mapping[str, str]
    not_seen_m: Mapping[str, float]
    seen_m: float
    offsets: Sequence[Mapping[str, str]] = ()
    dropped: Mapping[str, int] = field(default_factory=dict)
    notes: Sequence[str] = ()
    inputs: Sequence[Mapping[str, object]] = ()


def map_report(
    evidence: MapEvidence, *, verdict: Verdict, why: Sequence[str], advice: Sequence[str]
) -> ReportContent:
    """Return the report.

    Args:
        evidence: What it shows.
        verdict: How far the comparison can be trusted.
        why: Reasons for it.
        advice: What to do about it.
    """
    return ReportContent(
        title=f"{evidence.map_name} against the road",
        verdict=verdict,
        why=tuple(why),
        advice=tuple(advice),
        sections=(
            Section("Where map and road disagree", _findings(evidence)),
            Section("What was seen, and what was not", _coverage(evidence)),
            Section("How the poses lie against the map", _offsets(evidence)),
            Section("What was read", _inputs(evidence)),
        ),
    )


def _findings(evidence: MapEvidence) -> tuple[Block, ...]:
    findings = evidence.findings
    if not findings:
        return (Paragraph("Nowhere, as far as the road was seen: the next section says how far."),)
    counts = Counter(str(finding.kind) for finding in findings)
    kinds = tuple(
        (_word(kind), str(n), _MEANINGS.get(kind, "")) for kind, n in counts.most_common()
    )
    header = (
        "kind", "element", "along / length (m)", "offset (m)", "looks / drives", "confidence",
        "map", "road",
    )  # fmt: skip
    rows = tuple(_row(finding) for finding in findings[:_MOST_ROWS])
    shown = "" if len(findings) <= _MOST_ROWS else f"The first {_MOST_ROWS} of {len(findings)}"
    pictures = [
        _picture(evidence.pictures[finding.finding_id], finding)
        for finding in findings
        if finding.finding_id in evidence.pictures
    ]
    return (
        Table(("kind", "findings", "meaning"), kinds),
        Table(header, rows, shown),
        *pictures[:_MOST_PICTURES],
    )


def _word(kind: str) -> str:
    return kind.replace("_", " ")


def _row(finding: Discrepancy) -> tuple[str, ...]:
    offset = finding.offset_m
    return (
        _word(finding.kind),
        str(finding.map_element_id or "none"),
        f"{finding.along_m:.1f} / {finding.length_m:.1f}",
        f"{offset:+.2f} +- {finding.sd_m:.2f}" if math.isfinite(offset) else "",
        f"{finding.observations} / {finding.visits}",
        f"{finding.confidence:.2f}"
        + ("" if finding.status is Status.OPEN else f" {finding.status}"),
        finding.expected,
        finding.observed,
    )


def _picture(path: Path, finding: Discrepancy) -> Picture:
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    where = f"element {finding.map_element_id}" if finding.map_element_id else "no element"
    return Picture(
        f"data:image/png;base64,{data}",
        f"{_word(finding.kind)} at {where}, in the camera and from above",
        f"{_word(finding.kind)}, {where}: the map says {finding.expected}; "
        f"seen: {finding.observed}",
    )


def _coverage(evidence: MapEvidence) -> tuple[Block, ...]:
    rows = [("seen", f"{evidence.seen_m:.0f}")]
    rows += [
        (f"not seen: {reason}", f"{metres:.0f}") for reason, metres in evidence.not_seen_m.items()
    ]
    words = (
        "What was not seen is not judged: it never counts as missing. Each stretch stands in "
        "coverage.parquet."
    )
    return (
        Table(("lines of the map along the way", "metres"), tuple(rows)),
        Paragraph(words),
        Table(("what", "value"), tuple(evidence.facts.items())),
    )


def _offsets(evidence: MapEvidence) -> tuple[Block, ...]:
    if not evidence.offsets:
        return (Paragraph("Too little was seen to tell."),)
    header = tuple(evidence.offsets[0])
    rows = tuple(tuple(row.values()) for row in evidence.offsets[:_MOST_ROWS])
    words = (
        "What nearly all lines share is an error of poses or map as a whole, and is taken out "
        "before a single line counts as moved."
    )
    return (Table(header, rows), Paragraph(words))


def _inputs(evidence: MapEvidence) -> tuple[Block, ...]:
    blocks: list[Block] = []
    if evidence.dropped:
        left_out = tuple((reason, str(count)) for reason, count in evidence.dropped.items())
        blocks.append(Table(("left out", "count"), left_out))
    rows = tuple((str(i["path"]), str(i["bytes"])) for i in evidence.inputs)
    return (
        Table(("file", "bytes"), rows),
        *blocks,
        *(Paragraph(note) for note in evidence.notes),
    )
