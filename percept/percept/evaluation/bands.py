"""Range bands that recall and precision are told by."""

from __future__ import annotations

import bisect

__all__ = ["RANGE_BANDS", "range_band"]

_EDGES_M = (15.0, 30.0, 50.0)
RANGE_BANDS = ("0-15 m", "15-30 m", "30-50 m", "50+ m")


def range_band(range_m: float) -> str:
    """Return the band of a horizontal range; an edge belongs to the band beyond it."""
    return RANGE_BANDS[bisect.bisect_right(_EDGES_M, range_m)]
