"""The limits that an inspection judges by, all in one place."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from percept.core.settings import Settings

__all__ = ["InspectConfig"]


class InspectConfig(Settings):
    """Limits of gaps, of lateness, and of the verdict.

    Attributes:
        gap_intervals: An interval longer than this many median intervals is a gap.
        late_intervals: The watchdog's timeout, in nominal intervals.
        minimum_timeout_s: The watchdog never fires earlier than this, because recorders write
            fast streams in batches.
        irregular_jitter: A stream that is no sensor and whose jitter is more than this share of
            its median interval is sent on events, as is one that is silent for a quarter of its
            time; gaps and lateness then mean nothing.
        clock_jump_s: A step between header clock and log clock that counts as a jump.
        rates_hz: Nominal rates by topic; the median rate is taken where a topic is not named. A
            topic that is named here and not in the log makes the verdict bad.
        max_late_share: Share of time that a sensor may be late before it is doubtful.
        max_dropped_share: Share of messages that a sensor may have lost before it is doubtful.
        max_offset_s: Largest median difference between header clock and log clock.
        max_drift_ppm: Largest drift of the header clock against the log clock.
        max_disorder_share: Share of messages whose time is before that of the one before.
        max_duplicate_share: Share of messages with the header stamp of the one before.
        bad_share: A sensor is bad when more than this share of it is without stamps or out of
            order, or when its rate is given and it is late for more than this share of the time.
    """

    gap_intervals: float = Field(default=2.5, gt=1)
    late_intervals: float = Field(default=3.0, gt=1)
    minimum_timeout_s: float = Field(default=0.1, ge=0)
    irregular_jitter: float = Field(default=0.5, gt=0)
    clock_jump_s: float = Field(default=0.1, gt=0)
    rates_hz: dict[str, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    max_late_share: float = Field(default=0.05, ge=0, le=1)
    max_dropped_share: float = Field(default=0.02, ge=0, le=1)
    max_offset_s: float = Field(default=1.0, gt=0)
    max_drift_ppm: float = Field(default=200.0, gt=0)
    max_disorder_share: float = Field(default=0.01, ge=0, le=1)
    max_duplicate_share: float = Field(default=0.01, ge=0, le=1)
    bad_share: float = Field(default=0.5, gt=0, le=1)
