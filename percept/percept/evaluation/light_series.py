"""What a table says of one traffic light over time, and of the pieces between changes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.results import LightStates

__all__ = ["LightPiece", "LightSeries", "light_pieces", "light_series"]


@dataclass(frozen=True, slots=True, eq=False)
class LightSeries:
    """One light at N moments in order.

    Attributes:
        stamps_ns: (N,) int64.
        states: N words.
        flashing: (N,) bool.
        seen: (N,) bool whether a camera saw it.
    """

    stamps_ns: NDArray[np.int64]
    states: tuple[str, ...]
    flashing: NDArray[np.bool_]
    seen: NDArray[np.bool_]

    def nearest(self, stamp_ns: int, tolerance_ns: int) -> int | None:
        """Return the row nearest to a time, or None if it is further away than the tolerance."""
        if not len(self.stamps_ns):
            return None
        right = int(np.searchsorted(self.stamps_ns, stamp_ns))
        near = [row for row in (right - 1, right) if 0 <= row < len(self.stamps_ns)]
        row = min(near, key=lambda r: abs(int(self.stamps_ns[r]) - stamp_ns))
        return row if abs(int(self.stamps_ns[row]) - stamp_ns) <= tolerance_ns else None

    def first(self, start_ns: int, end_ns: int, wanted: NDArray[np.bool_]) -> int | None:
        """Return the stamp of the first wanted row in start <= stamp < end, or None."""
        inside = (self.stamps_ns >= start_ns) & (self.stamps_ns < end_ns) & wanted
        rows = np.flatnonzero(inside)
        return int(self.stamps_ns[rows[0]]) if len(rows) else None

    def shows(self, state: str) -> NDArray[np.bool_]:
        """Return where (N,) it shows a state."""
        return np.array([word == state for word in self.states], dtype=bool)


@dataclass(frozen=True, slots=True)
class LightPiece:
    """A stretch over which a light is seen and shows the same.

    Attributes:
        rows: First row and the row after the last one.
        state: What it shows.
        flashing: Whether it flashes.
        changed: Whether it showed something else just before, and was seen then.
    """

    rows: tuple[int, int]
    state: str
    flashing: bool
    changed: bool


def light_series(moments: Iterable[LightStates]) -> dict[int, LightSeries]:
    """Return what is said of each light, by its id."""
    rows: dict[int, list[tuple[int, str, bool, bool]]] = {}
    for lights in moments:
        for light, state, flashing, cameras in zip(
            lights.ids.tolist(),
            lights.states,
            lights.flashing.tolist(),
            lights.cameras,
            strict=True,
        ):
            rows.setdefault(light, []).append((lights.stamp_ns, state, flashing, bool(cameras)))
    return {light: _series(sorted(said)) for light, said in rows.items()}


def _series(said: list[tuple[int, str, bool, bool]]) -> LightSeries:
    stamps, states, flashing, seen = zip(*said, strict=True)
    return LightSeries(np.array(stamps, np.int64), states, np.array(flashing), np.array(seen))


def light_pieces(series: LightSeries, largest_gap_ns: int) -> Iterator[LightPiece]:
    """Yield the stretches over which a light is seen and shows the same, in order.

    Args:
        series: The light.
        largest_gap_ns: Moments that lie further apart are not one stretch.
    """
    start, changed = 0, False
    count = len(series.stamps_ns)
    for row in range(1, count + 1):
        seen_on = (
            row < count
            and bool(series.seen[row])
            and bool(series.seen[row - 1])
            and int(series.stamps_ns[row] - series.stamps_ns[row - 1]) <= largest_gap_ns
        )
        if seen_on and _shown(series, row) == _shown(series, row - 1):
            continue
        if series.seen[start]:
            yield LightPiece((start, row), *_shown(series, start), changed)
        start, changed = row, seen_on


def _shown(series: LightSeries, row: int) -> tuple[str, bool]:
    return series.states[row], bool(series.flashing[row])
