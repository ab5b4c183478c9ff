"""Running statistics that stay small however long the log is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["EvenSample", "MillisecondQuantiles"]

_Item = TypeVar("_Item")


class EvenSample(Generic[_Item]):
    """Keeps some items of a stream of unknown length, evenly spaced.

    Every `stride`-th item is made and kept; when there are twice as many as wanted, every other
    one goes and the stride doubles.

    Args:
        wanted: Number of items to end with, at least 1.
    """

    def __init__(self, wanted: int) -> None:
        self._wanted = wanted
        self._stride = 1
        self._seen = 0
        self._kept: list[_Item] = []

    def offer(self, make: Callable[[], _Item]) -> None:
        """Count an item of the stream, and make it if it is to be kept."""
        if self._seen % self._stride == 0:
            self._kept.append(make())
            if len(self._kept) == 2 * self._wanted:
                self._kept = self._kept[::2]
                self._stride *= 2
        self._seen += 1

    def chosen(self, most: int | None = None) -> list[_Item]:
        """Return at most `most` items, or as many as are wanted, from the first to the last."""
        count = len(self._kept)
        places = np.linspace(0, count - 1, min(count, most or self._wanted))
        return [self._kept[i] for i in places.round().astype(int)]


class MillisecondQuantiles:
    """Quantiles of durations from a histogram with bins 1 % wide, 1 us to 1,000 s."""

    _EDGES_MS: NDArray[np.float64] = np.geomspace(1e-3, 1e6, 2084)

    def __init__(self) -> None:
        self._counts: NDArray[np.int64] = np.zeros(len(self._EDGES_MS) + 1, dtype=np.int64)
        self.count = 0
        self.total_ms = 0.0

    def add(self, duration_ms: float) -> None:
        """Count a duration in milliseconds."""
        self._counts[np.searchsorted(self._EDGES_MS, duration_ms)] += 1
        self.count += 1
        self.total_ms += duration_ms

    def quantile_ms(self, share: float) -> float:
        """Return the duration that a share (0..1) of all does not exceed, to 1 %; NaN if none."""
        if self.count == 0:
            return float("nan")
        rank = max(1, int(np.ceil(share * self.count)))
        place = int(np.searchsorted(np.cumsum(self._counts), rank))
        return float(self._EDGES_MS[min(place, len(self._EDGES_MS) - 1)])
