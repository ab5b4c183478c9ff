"""Statistics of the time between messages, in memory that does not grow with the log."""

from __future__ import annotations

import heapq
import math

__all__ = ["IntervalHistogram"]

# Bins grow by 1 %: fine enough for every limit that is asked about, and a stream of steady
# rhythm fills a handful of them.
_LOG_BIN = math.log(1.01)
_LONGEST_KEPT = 20


class IntervalHistogram:
    """Positive intervals in logarithmic bins, with the longest few and where they are.

    Quantiles and sums are exact to the width of a bin, 1 %; they are exact altogether where
    all intervals of a bin are equal.

    Attributes:
        count: Number of intervals.
        total_ns: Their sum.
    """

    def __init__(self) -> None:
        self.count = 0
        self.total_ns = 0
        self._bins: dict[int, list[int]] = {}
        self._longest: list[tuple[int, int]] = []

    def add(self, interval_ns: int, start_ns: int) -> None:
        """Count one interval; one that is not positive is left out.

        Args:
            interval_ns: Its length.
            start_ns: When it began, so that the longest can be found in the log.
        """
        if interval_ns <= 0:
            return
        self.count += 1
        self.total_ns += interval_ns
        entry = self._bins.setdefault(int(math.log(interval_ns) / _LOG_BIN), [0, 0])
        entry[0] += 1
        entry[1] += interval_ns
        if len(self._longest) < _LONGEST_KEPT:
            heapq.heappush(self._longest, (interval_ns, start_ns))
        elif interval_ns > self._longest[0][0]:
            heapq.heapreplace(self._longest, (interval_ns, start_ns))

    def quantile_ns(self, share: float) -> float | None:
        """Return the interval that a share in 0..1 of all does not exceed; None when empty."""
        seen = 0
        for count, total_ns in (self._bins[key] for key in sorted(self._bins)):
            seen += count
            if seen >= share * self.count:
                return total_ns / count
        return None

    def above(self, limit_ns: float) -> list[tuple[int, float]]:
        """Return (count, mean length in ns) of every bin above a limit."""
        means = ((count, total_ns / count) for count, total_ns in self._bins.values())
        return [(count, mean_ns) for count, mean_ns in means if mean_ns > limit_ns]

    def longest(self, limit_ns: float) -> list[tuple[int, int]]:
        """Return (length, start) in ns of up to 20 intervals above a limit, longest first."""
        return sorted((kept for kept in self._longest if kept[0] > limit_ns), reverse=True)
