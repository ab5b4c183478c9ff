"""A heartbeat monitor that looks at a recorded log instead of a running car.

A stream is late while more time than its timeout has passed since its last message. The clock
is the recorder's, because that is when a monitor in the car would have had the message.
"""

from __future__ import annotations

from dataclasses import dataclass

from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.timing import StreamWatch

__all__ = ["Lateness", "lateness_of"]


@dataclass(frozen=True, slots=True)
class Lateness:
    """One line of the watchdog's table.

    Attributes:
        nominal_s: The interval that was expected: given, or the median.
        timeout_s: Silence beyond this is late.
        late_s: Time spent late, from the log's start to its end.
        late_share: The same as a share of the log.
        late_spans: How many times it became late.
        longest_s: The longest time it was late at a stretch, counted from the timeout on.
        longest_start_ns: Log time at which that silence began.
    """

    nominal_s: float
    timeout_s: float
    late_s: float
    late_share: float
    late_spans: int
    longest_s: float
    longest_start_ns: int | None


def lateness_of(
    watch: StreamWatch,
    nominal_s: float,
    span_ns: tuple[int, int],
    config: InspectConfig,
) -> Lateness:
    """Run the watchdog over one stream.

    Args:
        watch: The stream, at its end; it may be empty.
        nominal_s: The expected interval in seconds.
        span_ns: First and last log time of the whole log; silence before a stream's first
            and after its last message counts.
        config: The timeout's limits.
    """
    timeout_s = max(config.late_intervals * nominal_s, config.minimum_timeout_s)
    timeout_ns = timeout_s * 1e9
    edges = [edge for edge in _edges(watch, span_ns) if edge[0] > timeout_ns]
    inside = watch.log_intervals.above(timeout_ns)
    late_ns = sum(count * (mean_ns - timeout_ns) for count, mean_ns in inside)
    late_ns += sum(length_ns - timeout_ns for length_ns, _ in edges)
    longest = max([*watch.log_intervals.longest(timeout_ns), *edges], default=None)
    return Lateness(
        nominal_s=nominal_s,
        timeout_s=timeout_s,
        late_s=late_ns / 1e9,
        late_share=min(late_ns / max(span_ns[1] - span_ns[0], 1), 1.0),
        late_spans=sum(count for count, _ in inside) + len(edges),
        longest_s=0.0 if longest is None else (longest[0] - timeout_ns) / 1e9,
        longest_start_ns=None if longest is None else longest[1],
    )


def _edges(watch: StreamWatch, span_ns: tuple[int, int]) -> list[tuple[int, int]]:
    """Return (length, start) of the silence before the first and after the last message."""
    start_ns, end_ns = span_ns
    if watch.first_ns is None or watch.last_ns is None:
        return [(end_ns - start_ns, start_ns)]
    return [(watch.first_ns - start_ns, start_ns), (end_ns - watch.last_ns, watch.last_ns)]
