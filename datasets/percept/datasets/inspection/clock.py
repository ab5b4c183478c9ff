"""How the clock of the headers runs against the clock of the recorder."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["ClockHealth", "ClockJump", "ClockWatch"]

_BLOCK_NS = 1_000_000_000
_VALUES_KEPT = 4096
_JUMPS_KEPT = 20
_DRIFT_SPAN_NS = 10 * _BLOCK_NS
_DRIFT_BLOCKS = 5


@dataclass(frozen=True, slots=True)
class ClockJump:
    """A step of one clock against the other.

    Attributes:
        log_time_ns: Where it is.
        step_s: How much later than before the header clock is; negative when it fell back.
    """

    log_time_ns: int
    step_s: float


@dataclass(frozen=True, slots=True)
class ClockHealth:
    """Header stamps of one stream against its log times.

    Attributes:
        offset_s: Median of log time minus header stamp: the delay until recording where both
            clocks agree.
        spread_s: Half of the central 68 % of the offsets; the standard deviation of a normal one.
        drift_ppm: How fast the header clock gains on the log clock; None in less than 10 s.
        drift_sd_ppm: Its standard deviation.
        jumps: The first 20 jumps.
        jump_count: All jumps.
    """

    offset_s: float
    spread_s: float
    drift_ppm: float | None
    drift_sd_ppm: float | None
    jumps: tuple[ClockJump, ...]
    jump_count: int


class ClockWatch:
    """Follows the offset of one stream.

    Recording adds delays that are never negative, so that the smallest offset of each second
    follows the clocks, as in Moon, Skelly, Towsley: Estimation and removal of clock skew from
    network delay measurements (INFOCOM 1999). Jumps are steps between these minima; drift is
    their slope by least squares, common to all parts between jumps.

    Args:
        jump_s: The smallest step that counts as a jump.
    """

    def __init__(self, jump_s: float) -> None:
        self._jump_ns = jump_s * 1e9
        self._offsets = _ThinnedValues()
        self._block: tuple[int, int, int] | None = None
        self._last_minimum: int | None = None
        self._slope = _CommonSlope()
        self._jumps: list[ClockJump] = []
        self._jump_count = 0

    def add(self, log_time_ns: int, stamp_ns: int) -> None:
        """Take the two times of one message."""
        offset_ns = log_time_ns - stamp_ns
        self._offsets.append(offset_ns)
        if self._block is None or abs(log_time_ns - self._block[0]) >= _BLOCK_NS:
            self._close_block()
            self._block = (log_time_ns, log_time_ns, offset_ns)
        elif offset_ns < self._block[2]:
            self._block = (self._block[0], log_time_ns, offset_ns)

    def _close_block(self) -> None:
        if self._block is None:
            return
        _, at_ns, minimum_ns = self._block
        step_ns = 0 if self._last_minimum is None else self._last_minimum - minimum_ns
        if abs(step_ns) > self._jump_ns:
            self._jump_count += 1
            if self._jump_count <= _JUMPS_KEPT:
                self._jumps.append(ClockJump(at_ns, step_ns / 1e9))
            self._slope.start_part()
        self._slope.add(at_ns, -minimum_ns)
        self._last_minimum = minimum_ns

    def result(self) -> ClockHealth | None:
        """Return what was seen, or None without a message. To be called once, at the end."""
        if self._block is None:
            return None
        self._close_block()
        low, middle, high = (self._offsets.quantile(q) for q in (0.16, 0.5, 0.84))
        drift = self._slope.result()
        return ClockHealth(
            offset_s=middle / 1e9,
            spread_s=(high - low) / 2e9,
            drift_ppm=None if drift is None else drift[0] * 1e6,
            drift_sd_ppm=None if drift is None else drift[1] * 1e6,
            jumps=tuple(self._jumps),
            jump_count=self._jump_count,
        )


class _ThinnedValues:
    """Evenly spaced values of a stream: every second one goes whenever the store is full."""

    def __init__(self) -> None:
        self._values: list[int] = []
        self._stride = 1
        self._seen = 0

    def append(self, value: int) -> None:
        if self._seen % self._stride == 0:
            self._values.append(value)
            if len(self._values) == _VALUES_KEPT:
                self._values = self._values[::2]
                self._stride *= 2
        self._seen += 1

    def quantile(self, share: float) -> int:
        ordered = sorted(self._values)
        return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


class _CommonSlope:
    """One slope by least squares through several parts, each with its own level."""

    def __init__(self) -> None:
        self._points = 0
        self._parts = 1
        self._in_part = 0
        self._first_ns: int | None = None
        self._last_ns = 0
        self._level_ns = 0
        self._mean_x = self._mean_y = 0.0
        self._sums = [0.0, 0.0, 0.0]

    def start_part(self) -> None:
        self._parts += 1
        self._in_part = 0
        self._mean_x = self._mean_y = 0.0

    def add(self, x_ns: int, y_ns: int) -> None:
        """Add a point (Welford's update of sums of squares about the part's mean)."""
        if self._first_ns is None:
            self._first_ns = x_ns
        if self._in_part == 0:
            self._level_ns = y_ns
        self._last_ns = x_ns
        self._points += 1
        self._in_part += 1
        # Nanoseconds since 1970 do not fit a float; differences do.
        x, y = float(x_ns - self._first_ns), float(y_ns - self._level_ns)
        dx, dy = x - self._mean_x, y - self._mean_y
        self._mean_x += dx / self._in_part
        self._mean_y += dy / self._in_part
        self._sums[0] += dx * (x - self._mean_x)
        self._sums[1] += dx * (y - self._mean_y)
        self._sums[2] += dy * (y - self._mean_y)

    def result(self) -> tuple[float, float] | None:
        """Return the slope and its standard deviation, or None with too few points."""
        free = self._points - self._parts - 1
        xx, xy, yy = self._sums
        span_ns = self._last_ns - (self._first_ns or 0)
        if self._points < _DRIFT_BLOCKS or free < 1 or span_ns < _DRIFT_SPAN_NS or xx <= 0:
            return None
        residual = max(yy - xy * xy / xx, 0.0)
        return xy / xx, math.sqrt(residual / free / xx)
