"""How much of the map was seen, and why the rest was not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from percept.hdmap.validate.evidence import LineEvidence, reason_unseen
from percept.hdmap.validate.result import ElementCoverage
from percept.hdmap.validate.stop_lines import StopLineTally

__all__ = ["element_coverage"]

_STRETCH_M = 20.0


def element_coverage(
    lines: Sequence[LineEvidence], stop_lines: StopLineTally, looks: int
) -> Iterator[ElementCoverage]:
    """Return stretches of about 20 m of lines, and stop lines, that the drives came near."""
    for seen in lines:
        if seen.rows["sights"].any():
            yield from _line(seen)
    for marking, sums in zip(stop_lines.markings, stop_lines.known.rows, strict=True):
        if sums["sights"].any():
            is_seen = bool(sums["looks"] >= looks)
            yield ElementCoverage(
                map_element_id=marking.element_id,
                along_m=0.0,
                length_m=float(np.linalg.norm(np.diff(marking.points_map[[0, -1], :2], axis=0))),
                observed_share=float(is_seen),
                visits=int(sums["passes"]),
                reason="" if is_seen else reason_unseen(sums["sights"][None]),
            )


def _line(seen: LineEvidence) -> Iterator[ElementCoverage]:
    count = len(seen.rows)
    parts = max(1, round(seen.line.length_m / _STRETCH_M))
    edges = np.linspace(0, count, parts + 1).round().astype(int).tolist()
    for first, last in pairwise(edges):
        known, rows = seen.known[first:last], seen.rows[first:last]
        yield ElementCoverage(
            map_element_id=seen.line.marking.element_id,
            along_m=first * seen.line.step_m,
            length_m=(last - first) * seen.line.step_m,
            observed_share=float(known.mean()),
            visits=int(rows["passes"].max()),
            reason="" if known.all() else reason_unseen(rows["sights"][~known]),
        )
