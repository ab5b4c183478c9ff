"""A heartbeat monitor that looks at a finished log or run instead of a running car.

A stream is late while more time than its timeout has passed since its last message: what a
watchdog in the vehicle would have seen, at the same times.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

__all__ = [
    "MOST_SPANS",
    "HealthSpan",
    "Lateness",
    "StreamHealth",
    "lateness",
    "stream_health",
]

MOST_SPANS = 20
"""Of a stream so many late spans are named, the longest; all are counted."""

_NS_PER_S = 1e9
_LATE_INTERVALS = 3.0
_MINIMUM_TIMEOUT_S = 0.1


@dataclass(frozen=True, slots=True)
class HealthSpan:
    """A time in which a stream was late.

    Attributes:
        start_ns: When the timeout had passed.
        end_ns: When the next message came, or the log ended.
        reason: `silent`, `not started` or `ended`.
    """

    start_ns: int
    end_ns: int
    reason: str


@dataclass(frozen=True, slots=True)
class Lateness:
    """What the watchdog says of one stream.

    Attributes:
        nominal_s: The interval that was expected: given, or the median.
        timeout_s: Silence beyond this is late.
        late_s: Time spent late, from the log's start to its end.
        late_share: The same as a share of the log.
        late_spans: How many times it became late.
        longest_s: The longest time it was late at a stretch, counted from the timeout on.
        longest_start_ns: Time at which that silence began.
        spans: The times in which it was late, in order; the longest ones of very many.
    """

    nominal_s: float
    timeout_s: float
    late_s: float
    late_share: float
    late_spans: int
    longest_s: float
    longest_start_ns: int | None
    spans: tuple[HealthSpan, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHealth:
    """How a sensor or a detector kept its rhythm.

    Attributes:
        messages: How many there were.
        start_ns: First time of the log or run.
        end_ns: Its last time.
        rate_hz: Messages a second from its first to its last one; None for less than two.
        nominal_hz: The rate that was expected: given, or one over the median interval; None
            where neither is known.
        lateness: What the watchdog says; None where no rate can be expected.
    """

    messages: int
    start_ns: int
    end_ns: int
    rate_hz: float | None
    nominal_hz: float | None
    lateness: Lateness | None

    @property
    def spans(self) -> tuple[HealthSpan, ...]:
        """The times in which it was late, in order; the longest ones of very many."""
        return () if self.lateness is None else self.lateness.spans


def stream_health(
    stamps_ns: ArrayLike,
    span_ns: tuple[int, int],
    *,
    nominal_hz: float | None = None,
    late_intervals: float = _LATE_INTERVALS,
    minimum_timeout_s: float = _MINIMUM_TIMEOUT_S,
) -> StreamHealth:
    """Judge one stream of a finished run.

    Args:
        stamps_ns: (N,) times of its messages, in any order.
        span_ns: First and last time of the whole run; silence before the stream's first and
            after its last message counts.
        nominal_hz: The rate to expect; None takes one over the median interval.
        late_intervals: Silence of so many expected intervals is late.
        minimum_timeout_s: Silence of less than this is never late.
    """
    stamps = np.sort(np.asarray(stamps_ns, dtype=np.int64).reshape(-1))
    intervals = np.diff(stamps)
    rhythm = intervals[intervals > 0]
    if nominal_hz is None and len(rhythm):
        nominal_hz = _NS_PER_S / float(np.median(rhythm))
    length_ns = int(stamps[-1] - stamps[0]) if len(stamps) else 0
    late = None
    if nominal_hz is not None:
        timeout_s = max(late_intervals / nominal_hz, minimum_timeout_s)
        is_long = intervals > timeout_s * _NS_PER_S
        silences = [*zip(intervals[is_long].tolist(), stamps[:-1][is_long].tolist(), strict=True)]
        late = lateness(
            1 / nominal_hz,
            timeout_s,
            span_ns,
            (int(stamps[0]), int(stamps[-1])) if len(stamps) else None,
            counted=[(1, float(length)) for length, _ in silences],
            longest=silences,
        )
    return StreamHealth(
        messages=len(stamps),
        start_ns=span_ns[0],
        end_ns=span_ns[1],
        rate_hz=(len(stamps) - 1) * _NS_PER_S / length_ns if length_ns else None,
        nominal_hz=nominal_hz,
        lateness=late,
    )


def lateness(
    nominal_s: float,
    timeout_s: float,
    span_ns: tuple[int, int],
    first_last_ns: tuple[int, int] | None,
    *,
    counted: Iterable[tuple[int, float]],
    longest: Iterable[tuple[int, int]],
) -> Lateness:
    """Run the watchdog over the silences of one stream.

    Args:
        nominal_s: The expected interval.
        timeout_s: Silence beyond this is late.
        span_ns: First and last time of the whole log.
        first_last_ns: Times of the stream's first and last message; None if it has none.
        counted: Number and mean length in ns of all intervals that are longer than the timeout.
        longest: Length and start in ns of those of them that can be named.
    """
    timeout_ns = timeout_s * _NS_PER_S
    edges = [edge for edge in _edges(first_last_ns, span_ns) if edge[0] > timeout_ns]
    inside = [*counted]
    silences = [*((length, start, "silent") for length, start in longest), *edges]
    late_ns = sum(count * (mean_ns - timeout_ns) for count, mean_ns in inside)
    late_ns += sum(length_ns - timeout_ns for length_ns, _, _ in edges)
    worst = max(silences, default=None)
    return Lateness(
        nominal_s=nominal_s,
        timeout_s=timeout_s,
        late_s=late_ns / _NS_PER_S,
        late_share=min(late_ns / max(span_ns[1] - span_ns[0], 1), 1.0),
        late_spans=sum(count for count, _ in inside) + len(edges),
        longest_s=0.0 if worst is None else (worst[0] - timeout_ns) / _NS_PER_S,
        longest_start_ns=None if worst is None else worst[1],
        spans=_spans(silences, timeout_ns),
    )


def _spans(silences: Iterable[tuple[int, int, str]], timeout_ns: float) -> tuple[HealthSpan, ...]:
    named = heapq.nlargest(MOST_SPANS, silences)
    return tuple(
        HealthSpan(start_ns + round(timeout_ns), start_ns + length_ns, reason)
        for length_ns, start_ns, reason in sorted(named, key=lambda silence: silence[1])
    )


def _edges(
    first_last_ns: tuple[int, int] | None, span_ns: tuple[int, int]
) -> list[tuple[int, int, str]]:
    """Return length, start and reason of the silences before the first and after the last one."""
    start_ns, end_ns = span_ns
    if first_last_ns is None:
        return [(end_ns - start_ns, start_ns, "not started")]
    first_ns, last_ns = first_last_ns
    return [(first_ns - start_ns, start_ns, "not started"), (end_ns - last_ns, last_ns, "ended")]
