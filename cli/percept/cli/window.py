"""The part of a log that `--start` and `--end` name."""

from __future__ import annotations

import math

from percept.core.clock import ns_from_seconds
from percept.core.errors import UsageError
from percept.datasets.recording import Recording

__all__ = ["log_window_ns"]


def log_window_ns(
    recording: Recording, start_s: float | None, end_s: float | None
) -> tuple[int | None, int | None]:
    """Return the first and the last log time that are wanted; None is no limit.

    Args:
        recording: The log; its first log time is second 0.
        start_s: `--start`, seconds, or None.
        end_s: `--end`, seconds, or None.

    Raises:
        UsageError: If a time is no number of seconds from 0 on, or the end not after the start.
    """
    for flag, seconds in (("--start", start_s), ("--end", end_s)):
        if seconds is not None and not (math.isfinite(seconds) and 0 <= seconds < 1e9):
            raise UsageError(f"{flag} {seconds:g} is no time in seconds from the log's start")
    if end_s is not None and end_s <= (start_s or 0.0):
        raise UsageError(f"--end {end_s:g} is not after --start {start_s or 0:g}")
    first_ns = recording.start_ns or 0
    return (
        None if start_s is None else first_ns + ns_from_seconds(start_s),
        None if end_s is None else first_ns + ns_from_seconds(end_s),
    )
