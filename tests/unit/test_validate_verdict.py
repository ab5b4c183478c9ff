"""What a validation says of itself: enough data, a shift that is known, paint that shows."""

from __future__ import annotations

from collections import Counter

import pytest

from percept.core.results import Verdict
from percept.hdmap.validate.result import ElementCoverage, StretchOffset
from percept.hdmap.validate.verdict import judge


def _seen(length_m: float, share: float, reason: str = "") -> ElementCoverage:
    return ElementCoverage(
        map_element_id=1,
        along_m=0.0,
        length_m=length_m,
        observed_share=share,
        visits=1,
        reason=reason,
    )


def _offset(*, lines: float = 3.0, ambiguous: bool = False) -> StretchOffset:
    return StretchOffset(
        drive=0, along_m=0.0, x_m=0.0, y_m=0.0, yaw_rad=0.0, lateral_m=0.0, heading_rad=0.0,
        sd_m=0.1, lines=lines, ambiguous=ambiguous,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("coverage", "tied", "lines", "looks", "legible", "verdict", "why"),
    [
        ([_seen(100, 0.6)], 0, 3.0, 10, 1.0, Verdict.GOOD, "60 m of lines were seen, 0 m"),
        ([_seen(100, 0.6)], 0, 3.0, 9, 1.0, Verdict.BAD, "short of data: 9 looks saw 60 m"),
        ([_seen(100, 0.4)], 0, 3.0, 99, 1.0, Verdict.BAD, "short of data: 99 looks saw 40 m"),
        ([_seen(100, 0.6)], 0, 0.0, 99, 1.0, Verdict.BAD, "no paint lies on a line"),
        ([_seen(100, 0.6)], 3, 3.0, 99, 1.0, Verdict.GOOD, "60 m"),
        ([_seen(100, 0.6)], 4, 3.0, 99, 1.0, Verdict.AMBIGUOUS, "on 40 % of the way"),
        ([_seen(100, 0.6)], 0, 3.0, 99, 0.59, Verdict.DOUBTFUL, "paint is hard to see"),
        ([_seen(150, 0.4, "occluded")], 0, 3.0, 99, 1.0, Verdict.DOUBTFUL, "90 m were hidden"),
        ([_seen(150, 0.4, "too dark")], 0, 3.0, 99, 1.0, Verdict.DOUBTFUL, "90 m were hidden"),
        ([_seen(150, 0.4, "too far")], 0, 3.0, 99, 1.0, Verdict.GOOD, "60 m of lines were seen"),
    ],
)
def test_the_verdict_and_its_reason(
    coverage: list[ElementCoverage],
    tied: int,
    lines: float,
    looks: int,
    legible: float,
    verdict: Verdict,
    why: str,
) -> None:
    offsets = [_offset(lines=lines, ambiguous=number < tied) for number in range(10)]
    said = judge(coverage, offsets, Counter(looks=looks), legible)
    assert said[0] is verdict
    assert why in said[1]
