"""From what was gathered to findings, coverage and a verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from percept.core.map_findings import Decision, Discrepancy, Kind
from percept.hdmap.elements import Lanelet
from percept.hdmap.validate.config import ValidationConfig
from percept.hdmap.validate.coverage import element_coverage
from percept.hdmap.validate.decided import apply_decisions
from percept.hdmap.validate.evidence import LineEvidence, line_evidence
from percept.hdmap.validate.extra_lines import extra_lines, with_links
from percept.hdmap.validate.findings import Reporter
from percept.hdmap.validate.lane_width import lane_widths
from percept.hdmap.validate.line_findings import line_findings
from percept.hdmap.validate.offset import common_offset, offset_finding
from percept.hdmap.validate.result import StretchOffset, Validation
from percept.hdmap.validate.stations import Stations
from percept.hdmap.validate.stop_findings import (
    BarSeen,
    agreed_along,
    bars_seen,
    stop_line_findings,
)
from percept.hdmap.validate.stop_lines import StopLineTally
from percept.hdmap.validate.tally import Tally
from percept.hdmap.validate.unmatched import UnmatchedPaint
from percept.hdmap.validate.verdict import judge

__all__ = ["Gathered", "summarise"]

_TIED_TRUST = 0.6
_ALONG_LEAST_M = 0.15
_LEGIBLE_LENGTH_M = 50.0


@dataclass(eq=False, kw_only=True)
class Gathered:
    """All that the looks of the drives add up to.

    Attributes:
        config: What counts.
        lanelets: Of the map.
        stations: Of the painted lines of the map.
        unpainted: Of its other lines.
        tally: Sums of the stations.
        unmatched: Paint beside no line.
        stop_lines: Sums of stop lines.
        decisions: What persons said before.
        dropped: What was left out and why.
        drives: Names of the drives.
        sensors: Names of the sensors.
        offsets: Shift of the poses along the drives.
        counts: What was looked at.
    """

    config: ValidationConfig
    lanelets: Mapping[int, Lanelet]
    stations: Stations
    unpainted: Stations
    tally: Tally
    unmatched: UnmatchedPaint
    stop_lines: StopLineTally
    decisions: tuple[Decision, ...]
    dropped: Counter[str]
    drives: list[str] = field(default_factory=list)
    sensors: list[str] = field(default_factory=list)
    offsets: list[StretchOffset] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    def sensor(self, name: str) -> int:
        """Return the number of a sensor."""
        if name not in self.sensors:
            self.sensors.append(name)
        return self.sensors.index(name)


def summarise(gathered: Gathered) -> Validation:
    """Return what all looks together say."""
    gathered.tally.finish()
    gathered.stop_lines.finish()
    used = [offset.sd_m for offset in gathered.offsets if offset.lines > 0]
    shift_sd = float(np.median(used)) if used else gathered.config.pose_sd_m
    lines = [
        line_evidence(line, gathered.tally, gathered.config, shift_sd)
        for line in gathered.stations.lines
    ]
    bars = bars_seen(gathered.stop_lines.known)
    findings = [*_offset_findings(gathered, bars), *_local_findings(gathered, lines, bars)]
    counts = Counter(gathered.counts)
    findings = with_links(_trusted(findings, gathered, counts))
    findings = apply_decisions(findings, gathered.decisions, counts)
    findings = _named_apart(sorted(findings, key=lambda finding: -finding.confidence))
    for finding in findings:
        counts[f"findings: {finding.kind.value}"] += 1
    coverage = tuple(element_coverage(lines, gathered.stop_lines, gathered.config.looks))
    counts["lines that no drive came near"] = sum(not seen.rows["sights"].any() for seen in lines)
    verdict, why = judge(coverage, gathered.offsets, counts, _legible(lines))
    return Validation(
        discrepancies=tuple(findings),
        coverage=coverage,
        offsets=tuple(gathered.offsets),
        counts=counts,
        dropped=Counter({what: count for what, count in gathered.dropped.items() if count}),
        notes=tuple(_notes(gathered)),
        verdict=verdict,
        why=why,
    )


def _local_findings(
    gathered: Gathered, lines: Sequence[LineEvidence], bars: Sequence[BarSeen]
) -> Iterator[Discrepancy]:
    config, sensors = gathered.config, gathered.sensors
    reporter = Reporter(gathered.stations, sensors)
    legible = _legible(lines)
    found = [f for seen in lines for f in line_findings(seen, reporter, config, legible)]
    yield from found
    by_id = {seen.line.marking.element_id: seen for seen in lines}
    moved = [finding for finding in found if finding.kind is Kind.MOVED]
    yield from lane_widths(gathered.lanelets, by_id, moved, reporter, config)
    cells = gathered.unmatched.rows(config.looks)
    yield from extra_lines(
        cells,
        gathered.stations,
        gathered.unpainted,
        gathered.lanelets,
        gathered.tally,
        sensors,
        config,
    )
    yield from stop_line_findings(
        gathered.stop_lines, bars, _along(bars), gathered.stations, sensors, config
    )


def _along(bars: Sequence[BarSeen]) -> float:
    """Return how far the stop lines lie beyond the map's together."""
    agreed = agreed_along(bars)
    common = float(np.median([bar.offset_m for bar in agreed])) if agreed else 0.0
    return common if abs(common) > _ALONG_LEAST_M else 0.0


def _offset_findings(gathered: Gathered, bars: Sequence[BarSeen]) -> Iterator[Discrepancy]:
    """Return one finding for all drives, or one for each drive that has an offset of its own."""
    along = [(bar.yaw_rad, bar.offset_m) for bar in agreed_along(bars)]
    groups = {"": gathered.offsets}
    if len(gathered.drives) > 1:
        for number, name in enumerate(gathered.drives):
            groups[name] = [offset for offset in gathered.offsets if offset.drive == number]
    for whose, offsets in groups.items():
        common = common_offset(offsets, along)
        if common is None:
            continue
        finding = offset_finding(
            common,
            offsets,
            gathered.config,
            whose,
            has_stop_lines=bool(gathered.stop_lines.markings),
        )
        if finding is not None:
            yield finding
            if not whose:
                return


def _legible(lines: Sequence[LineEvidence]) -> float:
    """Return how well paint shows at all, from the solid lines of the map: half is enough."""
    solid = [seen for seen in lines if seen.line.marking.type.startswith("solid")]
    known = sum(float(seen.known.sum()) * seen.line.step_m for seen in solid)
    if known < _LEGIBLE_LENGTH_M:
        return 1.0
    painted = sum(float(seen.painted.sum()) * seen.line.step_m for seen in solid)
    return min(1.0, 2.0 * painted / known)


def _trusted(
    findings: list[Discrepancy], gathered: Gathered, counts: Counter[str]
) -> list[Discrepancy]:
    """Trust moved lines less where the shift was a tie, and leave out what is not likely."""
    places = np.array([[offset.x_m, offset.y_m] for offset in gathered.offsets]).reshape(-1, 2)
    kept = []
    for finding in findings:
        if finding.kind is Kind.MOVED and len(places):
            near = int(np.linalg.norm(places - finding.middle_map[:2], axis=1).argmin())
            if gathered.offsets[near].ambiguous:
                finding = replace(
                    finding,
                    confidence=_TIED_TRUST * finding.confidence,
                    observed=f"{finding.observed}; or the other lines moved the other way",
                )
        if finding.confidence < gathered.config.least_confidence:
            counts["findings that are not likely enough"] += 1
        else:
            kept.append(finding)
    return kept


def _named_apart(findings: Sequence[Discrepancy]) -> list[Discrepancy]:
    """Number findings that would have one name."""
    seen: Counter[str] = Counter()
    named = []
    for finding in findings:
        seen[finding.finding_id] += 1
        number = seen[finding.finding_id]
        name = finding.finding_id if number == 1 else f"{finding.finding_id}-n{number}"
        named.append(replace(finding, finding_id=name))
    return named


def _notes(gathered: Gathered) -> Iterator[str]:
    for number, name in enumerate(gathered.drives):
        lateral = [o.lateral_m for o in gathered.offsets if o.drive == number and o.lines > 0]
        if not lateral:
            yield f"{name}: no line of the map was seen, so that the poses were not corrected"
            continue
        spread = np.round(np.quantile(lateral, [0.05, 0.5, 0.95]), 2) + 0.0  # no -0.00
        low, middle, high = spread.tolist()
        yield (
            f"{name}: paint lay {middle:+.2f} m to the left of the map's lines, "
            f"{low:+.2f} to {high:+.2f} m along the drive; findings are relative to that"
        )
