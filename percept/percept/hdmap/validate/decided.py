"""Decisions of persons, brought to the findings of another run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from percept.core.map_findings import Decision, Discrepancy, Kind, Status

__all__ = ["apply_decisions"]

_NEAR_M = 10.0
_SAME_OFFSET_M = 0.2


def apply_decisions(
    findings: Sequence[Discrepancy], decisions: Sequence[Decision], counts: Counter[str]
) -> list[Discrepancy]:
    """Leave out what was rejected, and give the rest the status that it was given.

    Args:
        findings: Of this run.
        decisions: Of earlier runs; of several about one thing the last one counts.
        counts: How many were left out is counted here.
    """
    kept = []
    for finding in findings:
        decision = next((d for d in reversed(decisions) if _is_about(d, finding)), None)
        if decision is None:
            kept.append(finding)
        elif decision.status is Status.REJECTED:
            counts["findings that a person rejected before"] += 1
        else:
            kept.append(replace(finding, status=decision.status, finding_id=decision.finding_id))
    return kept


def _is_about(decision: Decision, finding: Discrepancy) -> bool:
    if (decision.kind, decision.map_element_id) != (finding.kind, finding.map_element_id):
        return False
    return _same_offset(decision, finding) and _same_place(decision, finding)


def _same_offset(decision: Decision, finding: Discrepancy) -> bool:
    if math.isnan(decision.offset_m) or math.isnan(finding.offset_m):
        return math.isnan(decision.offset_m) and math.isnan(finding.offset_m)
    spread = 3 * finding.sd_m if math.isfinite(finding.sd_m) else 0.0
    return abs(decision.offset_m - finding.offset_m) <= max(_SAME_OFFSET_M, spread)


def _same_place(decision: Decision, finding: Discrepancy) -> bool:
    if finding.kind is Kind.GLOBAL_OFFSET:
        return True
    if finding.map_element_id:
        first = max(decision.along_m, finding.along_m)
        last = min(decision.along_m + decision.length_m, finding.along_m + finding.length_m)
        return last > first or decision.length_m == 0
    x, y = finding.middle_map[:2].tolist()
    reach = max(_NEAR_M, (decision.length_m + finding.length_m) / 2)
    return math.hypot(x - decision.x_m, y - decision.y_m) <= reach
