"""How far a validation can be trusted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from percept.core.results import Verdict
from percept.hdmap.validate.result import ElementCoverage, StretchOffset

__all__ = ["judge"]

_LEAST_LOOKS = 10
_LEAST_LENGTH_M = 50.0
_LEGIBLE = 0.6
_TIES = 0.3


def judge(
    coverage: Sequence[ElementCoverage],
    offsets: Sequence[StretchOffset],
    counts: Counter[str],
    legible: float,
) -> tuple[Verdict, str]:
    """Return the verdict and its reason.

    Args:
        coverage: Of the elements near the drives.
        offsets: Along the drives.
        counts: With the number of looks.
        legible: 0..1, how well paint shows at all.
    """
    seen = sum(stretch.length_m * stretch.observed_share for stretch in coverage)
    if counts["looks"] < _LEAST_LOOKS or seen < _LEAST_LENGTH_M:
        return Verdict.BAD, (
            f"short of data: {counts['looks']} looks saw {seen:.0f} m of the map's lines"
        )
    if not any(offset.lines > 0 for offset in offsets):
        return Verdict.BAD, "no paint lies on a line of the map: poses or map are far off"
    tied = sum(offset.ambiguous for offset in offsets) / len(offsets)
    if tied > _TIES:
        return Verdict.AMBIGUOUS, (
            f"on {100 * tied:.0f} % of the way two shifts of the poses fit the lines equally well"
        )
    if legible < _LEGIBLE:
        return Verdict.DOUBTFUL, "most solid lines of the map do not show: paint is hard to see"
    hidden = sum(
        stretch.length_m * (1.0 - stretch.observed_share)
        for stretch in coverage
        if stretch.reason in ("occluded", "too dark")
    )
    said = f"{seen:.0f} m of lines were seen, {hidden:.0f} m were hidden or in the dark"
    if seen < hidden:
        return Verdict.DOUBTFUL, said
    return Verdict.GOOD, said
