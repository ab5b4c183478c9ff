"""A finding in words and plain values, as the page shows it and as exports name it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from percept.core.map_findings import Kind
from percept.review.run import Finding, ReviewRun
from percept.review.store import Entry

__all__ = ["KIND_NAMES", "claim", "coverage", "entry_values", "finding_values"]

_METRES = re.compile(r"\d m\b")

KIND_NAMES: Mapping[Kind, str] = {
    Kind.MISSING_ON_ROAD: "missing on road",
    Kind.MISSING_IN_MAP: "missing in map",
    Kind.MOVED: "moved",
    Kind.TYPE: "type",
    Kind.COLOUR: "colour",
    Kind.STOP_LINE_MISSING: "stop line missing",
    Kind.STOP_LINE_MISSING_IN_MAP: "stop line missing in map",
    Kind.STOP_LINE_MOVED: "stop line moved",
    Kind.LANE_WIDTH: "lane width",
    Kind.TRAFFIC_LIGHT_MISSING: "traffic light missing",
    Kind.TRAFFIC_LIGHT_MISSING_IN_MAP: "traffic light missing in map",
    Kind.GLOBAL_OFFSET: "global offset",
}
"""What people call the kinds."""


def claim(finding: Finding) -> str:
    """Return a finding as one sentence, such as people can say yes or no to.

    For example: `way 123: map says solid white, seen dashed white over 38 m, 6 looks in 2
    visits, offset +0.04 m`.
    """
    told = finding.length_m < 1 or _METRES.search(finding.observed)
    over = "" if told else f" over {finding.length_m:.0f} m"
    parts = [
        f"map says {finding.expected or 'nothing'}",
        f"seen {finding.observed or 'nothing'}{over}",
        f"{_counted(finding.observations, 'look')} in {_counted(finding.visits, 'visit')}",
    ]
    if not math.isnan(finding.offset_m):
        parts.append(f"offset {finding.offset_m:+.2f} m")
    return f"{_element(finding)}: {', '.join(parts)}"


def coverage(run: ReviewRun) -> str:
    """Return how much of the map was seen in the drives, in words; empty where it is not known.

    Without it, silence would read as "the map is right".
    """
    counts: Any = run.info.get("counts")
    try:
        seen_m = float(counts["seen_m"])
        missing = [f"{float(metres):.0f} m {why}" for why, metres in counts["not_seen_m"].items()]
    except (LookupError, TypeError, ValueError, AttributeError):
        return ""
    return f"{seen_m:.0f} m of lines seen; not seen: {', '.join(missing) or 'none'}"


def _element(finding: Finding) -> str:
    if finding.kind is Kind.GLOBAL_OFFSET:
        return "whole map"
    return f"way {finding.map_element_id}" if finding.map_element_id else "not in the map"


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def finding_values(finding: Finding) -> dict[str, Any]:
    """Return a finding as plain values for JSON; what is not known is None."""
    return {
        "id": finding.finding_id,
        "kind": str(finding.kind),
        "name": KIND_NAMES[finding.kind],
        "claim": claim(finding),
        "element": str(finding.map_element_id),  # JavaScript's numbers end at 2**53
        "along": finding.along_m,
        "length": finding.length_m,
        "offset": _or_none(finding.offset_m),
        "sd": _or_none(finding.sd_m),
        "observations": finding.observations,
        "visits": finding.visits,
        "confidence": finding.confidence,
        "urgency": finding.urgency,
        "evidence": bool(finding.evidence),
        "status": str(finding.status),
        "x": _or_none(finding.x_m),
        "y": _or_none(finding.y_m),
        "latitude": _or_none(finding.latitude_deg),
        "longitude": _or_none(finding.longitude_deg),
        "points": finding.points_m,
        "expected": finding.points_expected_m,
        "drive": finding.drive,
        "sensor": finding.sensor,
        "time": _time(finding.stamp_ns),
        "stamp": str(finding.stamp_ns),
    }


def entry_values(entry: Entry) -> dict[str, Any]:
    """Return a decision of the history as plain values for JSON."""
    return {
        "id": entry.decision.finding_id,
        "revision": entry.revision,
        "status": str(entry.decision.status),
        "comment": entry.decision.comment,
        "decided_at": entry.decided_at,
    }


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _time(stamp_ns: int) -> str:
    """Return a time of the log to the millisecond in UTC; empty where there is none."""
    if stamp_ns <= 0:
        return ""
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    moment = datetime.fromtimestamp(seconds, UTC).replace(tzinfo=None)
    return f"{moment.isoformat(sep=' ')}.{rest // 1_000_000:03d} UTC"
