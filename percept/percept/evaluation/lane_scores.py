"""How well lines and stop lines were seen on a road: what was counted, as figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from percept.core.results import Verdict

__all__ = ["LINE_BANDS_M", "STOP_LINE_BANDS_M", "BandErrors", "RoadLaneScores"]

_F64 = NDArray[np.float64]

LINE_BANDS_M = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0)
"""Limits of the bands of range in which lines are scored."""

STOP_LINE_BANDS_M = (0.0, 6.0, 12.0, 20.0, 30.0)
"""Limits of the bands of range in which stop lines are scored."""

_FEW_FRAMES = 30


@dataclass(frozen=True, slots=True)
class BandErrors:
    """Errors within a band of range, in metres, signed."""

    errors_m: _F64

    def document(self) -> dict[str, Any]:
        """Return their number, mean, mean of the sizes, and 95th percentile of the sizes."""
        if not len(self.errors_m):
            return {"count": 0, "mean_m": None, "mean_abs_m": None, "p95_abs_m": None}
        sizes = np.abs(self.errors_m)
        return {
            "count": len(sizes),
            "mean_m": float(self.errors_m.mean()),
            "mean_abs_m": float(sizes.mean()),
            "p95_abs_m": float(np.percentile(sizes, 95)),
        }


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RoadLaneScores:
    """How well lines and stop lines were seen.

    Attributes:
        frames: Moments that were scored.
        both_sides: Of these, both lines of the vehicle's lane were found, and are those.
        lateral: (N, 2) range and signed lateral error of points that lie on a line.
        stray_points: Points of lines that are further than 1 m from any line.
        length_m: Length of what was seen on lines.
        right_type_m: Of it, the length of which the type is right.
        right_colour_m: Of it, the length of which the colour is right.
        unknown_type_m: Of it, the length of which the type is said to be unknown.
        unknown_colour_m: The same of the colour.
        stops: (S, 2) range and signed error of stop lines that were seen.
        stops_ahead: True distances of the stop lines that the lane led to, a row a moment.
        stops_found: Of these, whether it was seen.
        false_stops: Stop lines that were seen where none is.
        dropped: What was left out, by reason.
    """

    frames: int
    both_sides: int
    lateral: _F64
    stray_points: int
    length_m: float
    right_type_m: float
    right_colour_m: float
    unknown_type_m: float
    unknown_colour_m: float
    stops: _F64
    stops_ahead: _F64
    stops_found: NDArray[np.bool_]
    false_stops: int
    dropped: Counter[str] = field(default_factory=Counter)

    def lateral_bands(self) -> dict[str, BandErrors]:
        """Return the lateral errors by band of range."""
        return _bands(self.lateral, LINE_BANDS_M)

    def stop_line_bands(self) -> dict[str, BandErrors]:
        """Return the errors of stop lines by band of range."""
        return _bands(self.stops, STOP_LINE_BANDS_M)

    @property
    def verdict(self) -> Verdict:
        """How far the figures can be trusted; it does not judge the results."""
        if not self.frames or not len(self.lateral):
            return Verdict.BAD
        return Verdict.DOUBTFUL if self.why else Verdict.GOOD

    @property
    def why(self) -> tuple[str, ...]:
        """Reasons for the verdict."""
        if not self.frames:
            return ("no image was taken at a time that the poses cover",)
        why = []
        if not len(self.lateral):
            why.append("no line was seen on a line of the road")
        if self.frames < _FEW_FRAMES:
            why.append(f"{self.frames} images are few, from {_FEW_FRAMES} on figures count")
        return tuple(why)

    def document(self) -> dict[str, Any]:
        """Return all figures by name; None where there is nothing to divide by."""
        return {
            "frames": self.frames,
            "both_sides_share": _share(self.both_sides, self.frames),
            "lateral_error_m": {k: v.document() for k, v in self.lateral_bands().items()},
            "stray_share": _share(self.stray_points, self.stray_points + len(self.lateral)),
            "length_m": self.length_m,
            "type_share": _share(self.right_type_m, self.length_m),
            "colour_share": _share(self.right_colour_m, self.length_m),
            "unknown_type_share": _share(self.unknown_type_m, self.length_m),
            "unknown_colour_share": _share(self.unknown_colour_m, self.length_m),
            "stop_line_error_m": {k: v.document() for k, v in self.stop_line_bands().items()},
            "stop_lines_found_share": {
                _name(low, high): _share(
                    int(self.stops_found[_within(self.stops_ahead, low, high)].sum()),
                    int(_within(self.stops_ahead, low, high).sum()),
                )
                for low, high in pairwise(STOP_LINE_BANDS_M)
            },
            "false_stop_lines": self.false_stops,
            "verdict": str(self.verdict),
            "why": list(self.why),
            "dropped": dict(self.dropped),
        }


def _bands(rows: _F64, limits: Sequence[float]) -> dict[str, BandErrors]:
    return {
        _name(low, high): BandErrors(rows[_within(rows[:, 0], low, high), 1])
        for low, high in pairwise(limits)
    }


def _within(ranges: _F64, low: float, high: float) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (ranges >= low) & (ranges < high)
    return inside


def _name(low: float, high: float) -> str:
    return f"{low:g}-{high:g}"


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole else None
