"""Time as int64 nanoseconds since the Unix epoch.

Float seconds lose about 200 ns at today's epoch, so they appear only where a person reads
or types them.
"""

from __future__ import annotations

from datetime import UTC, datetime

__all__ = ["NS_PER_MS", "NS_PER_S", "iso_from_ns", "ns_from_seconds", "seconds_from_ns"]

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000


def ns_from_seconds(seconds: float) -> int:
    """Return a duration in seconds as whole nanoseconds, rounded to nearest."""
    return round(seconds * NS_PER_S)


def seconds_from_ns(duration_ns: int) -> float:
    """Return a duration in nanoseconds as seconds."""
    return duration_ns / NS_PER_S


def iso_from_ns(stamp_ns: int) -> str:
    """Return a stamp as ISO 8601 in UTC with microseconds, for people."""
    whole_s, rest_ns = divmod(stamp_ns, NS_PER_S)
    moment = datetime.fromtimestamp(whole_s, tz=UTC).replace(microsecond=rest_ns // 1000)
    return moment.isoformat().replace("+00:00", "Z")
