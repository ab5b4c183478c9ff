"""When was each point measured? Per-point times in the names and units seen in the wild.

Drivers agree on neither. The rule, which decides by magnitude because the names do not say it:

1. A pair of whole columns `time_sec` and `time_nsec` is an absolute time.
2. Whole numbers named `t`, `offset_time` or `time_stamp` are nanoseconds relative to the
   stamp (Ouster, Livox, Autoware), as long as none is a second or more away.
3. An absolute time lies within a second of the stamp, in s, ms, us or ns, and its number is
   larger than 10 s, so that it cannot be mistaken for a relative one.
4. A relative time spans a scan of 1 ms to 0.5 s: in seconds the largest magnitude lies in
   0.001 to 0.5, in milliseconds in 1 to 500, and so on. These intervals do not overlap.
   Seconds may also be shorter or reach 1 s, for floats only. Times that start far from zero
   compared with what they span are counters of another clock, not relative times.

What fits nothing is refused with a reason; it is never scaled by a guess. A cloud with fewer
than about half a millisecond of whole-number times under another name (one packet of a driver
that writes ns) would fit microseconds: such clouds need one of the names of rule 2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S

__all__ = ["TIME_NAMES", "TIME_PAIRS", "UnclearTimesError", "offsets_from_pair", "offsets_ns"]

TIME_NAMES = (
    "t",
    "offset_time",
    "time_offset",
    "time",
    "time_stamp",
    "timestamp",
    "timestamps",
    "offset_ns",
)
TIME_PAIRS = (("time_sec", "time_nsec"), ("sec", "nsec"), ("time_s", "time_ns"))

_NANOSECOND_NAMES = ("t", "offset_time", "time_stamp", "offset_ns")
_UNITS_NS = (NS_PER_S, 1_000_000, 1_000, 1)
_SHORTEST_SCAN_NS = 1e6
_LONGEST_SCAN_NS = 0.5e9
_LARGEST_OFFSET_NS = NS_PER_S
_SMALLEST_ABSOLUTE_NS = 10 * NS_PER_S
_LARGEST_START_IN_SPANS = 100
_LARGEST_EPOCH_NS = 2**62


class UnclearTimesError(Exception):
    """Per-point times that fit no rule; the message says why."""


def offsets_from_pair(
    seconds: NDArray[np.generic], nanoseconds: NDArray[np.generic], stamp_ns: int | None
) -> NDArray[np.int64]:
    """Return offsets (N,) int64 ns relative to the stamp from absolute seconds and nanoseconds.

    Args:
        seconds: (N,) whole seconds since the epoch.
        nanoseconds: (N,) the rest.
        stamp_ns: Stamp of the cloud; None stands for the earliest point.

    Raises:
        UnclearTimesError: If they are further than a second from the stamp.
    """
    with np.errstate(invalid="ignore"):
        whole = np.asarray(seconds).astype(np.int64)
        rest = np.asarray(nanoseconds).astype(np.int64)
    if not len(whole):
        return whole
    if abs(whole).max() > _LARGEST_EPOCH_NS // NS_PER_S:
        raise UnclearTimesError("they are no times since 1970")
    times_ns = whole * NS_PER_S + rest
    offsets = times_ns - (int(times_ns.min()) if stamp_ns is None else stamp_ns)
    if abs(offsets).max() > _LARGEST_OFFSET_NS:
        raise UnclearTimesError("they are more than 1 s from the stamp")
    return offsets


def offsets_ns(values: NDArray[np.generic], name: str, stamp_ns: int | None) -> NDArray[np.int64]:
    """Return offsets (N,) int64 ns relative to the stamp from one column of times.

    Args:
        values: (N,) integers or floats.
        name: Name of the column.
        stamp_ns: Stamp of the cloud; None where the file has none: then it stands for the
            earliest point of absolute times.

    Raises:
        UnclearTimesError: If they fit no rule of this module.
    """
    if not len(values):
        return np.zeros(0, dtype=np.int64)
    is_float = np.issubdtype(values.dtype, np.floating)
    if is_float and not np.isfinite(values).all():
        raise UnclearTimesError("some are not finite")
    low, high = float(values.min()), float(values.max())
    largest = max(abs(low), abs(high))
    if not is_float and name in _NANOSECOND_NAMES and largest < _LARGEST_OFFSET_NS:
        return values.astype(np.int64)
    unit_ns = _absolute_unit(low, high, stamp_ns)
    if unit_ns is not None:
        return _relative_to(values, unit_ns, stamp_ns)
    unit_ns = _relative_unit(low, high, is_float=is_float)
    return np.rint(values.astype(np.float64) * unit_ns).astype(np.int64)


def _absolute_unit(low: float, high: float, stamp_ns: int | None) -> int | None:
    for unit_ns in _UNITS_NS:
        earliest, latest = low * unit_ns, high * unit_ns
        if not _SMALLEST_ABSOLUTE_NS < earliest <= latest < _LARGEST_EPOCH_NS:
            continue
        near = (
            # Without a stamp an epoch after 2001 is asked for: it cannot be a counter.
            earliest > 1e18 and latest - earliest <= _LARGEST_OFFSET_NS
            if stamp_ns is None
            else max(abs(earliest - stamp_ns), abs(latest - stamp_ns)) <= _LARGEST_OFFSET_NS
        )
        if near:
            return unit_ns
    return None


def _relative_to(
    values: NDArray[np.generic], unit_ns: int, stamp_ns: int | None
) -> NDArray[np.int64]:
    """Subtract before scaling: an epoch in float64 nanoseconds has steps of 256 ns."""
    if unit_ns == 1:
        times_ns = values.astype(np.int64)
        return times_ns - (int(times_ns.min()) if stamp_ns is None else stamp_ns)
    if stamp_ns is None:
        # Both are exact: integers below 2**62, or a float minus one of its own kind.
        since_first: NDArray[np.float64] = np.subtract(values, values.min()).astype(np.float64)
        return np.rint(since_first * unit_ns).astype(np.int64)
    whole, rest_ns = divmod(stamp_ns, unit_ns)
    since_whole = values.astype(np.float64) - whole
    return np.rint(since_whole * unit_ns).astype(np.int64) - rest_ns


def _relative_unit(low: float, high: float, *, is_float: bool) -> int:
    largest = max(abs(low), abs(high))
    nearest = 0.0 if low <= 0 <= high else min(abs(low), abs(high))
    if largest == 0:
        raise UnclearTimesError("all are zero")
    if is_float and largest <= 1:
        return NS_PER_S
    if nearest > _LARGEST_START_IN_SPANS * (high - low):
        raise UnclearTimesError("they belong to another clock")
    for unit_ns in _UNITS_NS[1:]:
        if _SHORTEST_SCAN_NS <= largest * unit_ns <= _LONGEST_SCAN_NS:
            return unit_ns
    raise UnclearTimesError("they fit no unit")
