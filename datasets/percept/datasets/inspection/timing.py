"""When the messages of one stream come: rate, jitter, gaps, order, and the watchdog."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from percept.datasets.inspection.clock import ClockHealth, ClockWatch
from percept.datasets.inspection.config import InspectConfig
from percept.datasets.inspection.intervals import IntervalHistogram
from percept.datasets.inspection.kinds import SENSOR_KINDS
from percept.datasets.recording import Envelope

__all__ = ["Gap", "StreamOrder", "StreamTiming", "StreamWatch"]

# With fewer intervals than this, a median says nothing about a rhythm.
_RHYTHM_INTERVALS = 4
# A stream that is no sensor and spends more of its time than this in gaps is sent on events.
_SILENCE_OF_EVENTS = 0.25


@dataclass(frozen=True, slots=True)
class Gap:
    """One silence.

    Attributes:
        start_ns: Log time of the last message before it.
        length_s: Until the next message.
        dropped: How many messages would have fitted in.
    """

    start_ns: int
    length_s: float
    dropped: int


@dataclass(frozen=True, slots=True)
class StreamTiming:
    """Rhythm of one stream.

    Attributes:
        clock: `header` where every message has a stamp, else `log`.
        rate_hz: One over the median interval; None for less than two messages.
        median_interval_s: Median time between messages.
        jitter_s: Half of the central 68 % of the intervals; the standard deviation of normal ones.
        periodic: Whether the stream has a rhythm, as sensors do; gaps are looked for only then.
        gap_count: Intervals longer than the gap limit.
        gaps: Up to 20 of them, longest first.
        dropped_estimate: Messages that would have fitted into the gaps.
    """

    clock: str
    rate_hz: float | None
    median_interval_s: float | None
    jitter_s: float | None
    periodic: bool
    gap_count: int
    gaps: tuple[Gap, ...]
    dropped_estimate: int


@dataclass(frozen=True, slots=True)
class StreamOrder:
    """What is wrong with the times of one stream, in numbers of messages.

    Attributes:
        log_disorder: Log time before that of the message before.
        header_disorder: Header stamp before that of the message before.
        duplicate_stamps: Header stamp equal to that of the message before.
        zero_stamps: Header stamp zero.
    """

    log_disorder: int
    header_disorder: int
    duplicate_stamps: int
    zero_stamps: int


class StreamWatch:
    """Sees every envelope of one topic once, and keeps running figures only.

    Args:
        config: Limits.
        kind: Kind of the stream. A sensor is taken to have a rhythm however badly it keeps it;
            another stream has one when its intervals are alike.
    """

    def __init__(self, config: InspectConfig, kind: str) -> None:
        self._config = config
        self._kind = kind
        self.count = 0
        self.size_bytes = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        self.log_intervals = IntervalHistogram()
        self._header_intervals = IntervalHistogram()
        self._clock = ClockWatch(config.clock_jump_s)
        self._last_times: tuple[int, int] | None = None
        self._stamps = 0
        self._log_disorder = 0
        self._header_disorder = 0
        self._duplicates = 0
        self._zeros = 0

    def add(self, envelope: Envelope) -> None:
        """Take the next message."""
        self.count += 1
        self.size_bytes += envelope.size_bytes
        now_ns = envelope.log_time_ns
        if self.last_ns is not None:
            self.log_intervals.add(now_ns - self.last_ns, self.last_ns)
            self._log_disorder += now_ns < self.last_ns
        self.first_ns = now_ns if self.first_ns is None else min(self.first_ns, now_ns)
        self.last_ns = now_ns
        if envelope.stamp_ns == 0 and now_ns != 0:
            self._zeros += 1
        elif envelope.stamp_ns is not None:
            self._add_stamp(now_ns, envelope.stamp_ns)

    def _add_stamp(self, now_ns: int, stamp_ns: int) -> None:
        self._stamps += 1
        self._clock.add(now_ns, stamp_ns)
        if self._last_times is not None:
            before_ns, log_before_ns = self._last_times
            self._header_intervals.add(stamp_ns - before_ns, log_before_ns)
            self._header_disorder += stamp_ns < before_ns
            self._duplicates += stamp_ns == before_ns
        self._last_times = stamp_ns, now_ns

    def timing(self) -> StreamTiming:
        """Return the rhythm."""
        # A message of tf holds the stamps of several senders; they make no rhythm together.
        by_header = self._kind != "tf" and 0 < self._stamps == self.count
        intervals = self._header_intervals if by_header else self.log_intervals
        clock = "header" if by_header else "log"
        median_ns = intervals.quantile_ns(0.5)
        low_ns, high_ns = intervals.quantile_ns(0.16), intervals.quantile_ns(0.84)
        if median_ns is None or low_ns is None or high_ns is None:
            return StreamTiming(
                clock=clock,
                rate_hz=None,
                median_interval_s=None,
                jitter_s=None,
                periodic=False,
                gap_count=0,
                gaps=(),
                dropped_estimate=0,
            )
        jitter_ns = (high_ns - low_ns) / 2
        periodic = intervals.count >= _RHYTHM_INTERVALS and (
            self._kind in SENSOR_KINDS or self._keeps_time(intervals, median_ns, jitter_ns)
        )
        limit_ns = self._config.gap_intervals * median_ns
        long = intervals.above(limit_ns) if periodic else []
        longest = intervals.longest(limit_ns) if periodic else []
        return StreamTiming(
            clock=clock,
            rate_hz=1e9 / median_ns,
            median_interval_s=median_ns / 1e9,
            jitter_s=jitter_ns / 1e9,
            periodic=periodic,
            gap_count=sum(count for count, _ in long),
            gaps=tuple(_gaps(longest, median_ns)),
            dropped_estimate=sum(count * _missing(mean, median_ns) for count, mean in long),
        )

    def _keeps_time(self, intervals: IntervalHistogram, median_ns: float, jitter_ns: float) -> bool:
        """Return whether the intervals are alike, and not those of a few bursts."""
        silent_ns = sum(count * mean_ns for count, mean_ns in intervals.above(2 * median_ns))
        steady = jitter_ns <= self._config.irregular_jitter * median_ns
        return steady and silent_ns <= _SILENCE_OF_EVENTS * intervals.total_ns

    def clock(self) -> ClockHealth | None:
        """Return header against log clock, or None for a stream without stamps."""
        return self._clock.result()

    def order(self) -> StreamOrder:
        """Return what is out of order."""
        return StreamOrder(self._log_disorder, self._header_disorder, self._duplicates, self._zeros)


def _missing(interval_ns: float, median_ns: float) -> int:
    return max(round(interval_ns / median_ns) - 1, 0)


def _gaps(longest: Iterable[tuple[int, int]], median_ns: float) -> Iterable[Gap]:
    for length_ns, start_ns in longest:
        yield Gap(start_ns, length_ns / 1e9, _missing(length_ns, median_ns))
