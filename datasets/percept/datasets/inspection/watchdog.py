"""The watchdog of `percept.core.health` over the running figures of one stream.

The clock is the recorder's, because that is when a monitor in the car would have had the message.
"""

from __future__ import annotations

from percept.core.health import Lateness, lateness
from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.timing import StreamWatch

__all__ = ["lateness_of"]


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
    first_ns, last_ns = watch.first_ns, watch.last_ns
    return lateness(
        nominal_s,
        timeout_s,
        span_ns,
        None if first_ns is None or last_ns is None else (first_ns, last_ns),
        counted=watch.log_intervals.above(timeout_ns),
        longest=watch.log_intervals.longest(timeout_ns),
    )
