"""Whether sensors and detectors of a run kept their rhythm: for `run.json` and the view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from numpy.typing import ArrayLike

from percept.core.health import StreamHealth, stream_health

__all__ = ["health_as_json", "run_health"]


def run_health(
    events: Mapping[str, ArrayLike], nominal_hz: Mapping[str, float] | None = None
) -> dict[str, StreamHealth]:
    """Judge the streams of a run against each other's time.

    Args:
        events: By name of the sensor or detector, the times (N,) ns of what it delivered; what
            it failed at is left out. A name without any is a stream that was expected.
        nominal_hz: By name, the rate to expect; that of the median interval where not given.

    Returns:
        By name, in the order of the events. Their common span is from the first to the last
        event of all.
    """
    stamps = {name: np.asarray(times, dtype=np.int64) for name, times in events.items()}
    everything = np.concatenate([np.zeros(0, np.int64), *stamps.values()])
    span_ns = (int(everything.min()), int(everything.max())) if len(everything) else (0, 0)
    rates = nominal_hz or {}
    return {
        name: stream_health(times, span_ns, nominal_hz=rates.get(name))
        for name, times in stamps.items()
    }


def health_as_json(health: Mapping[str, StreamHealth]) -> dict[str, dict[str, object]]:
    """Return what `run.json` says of the health of a run, by name of the sensor or detector."""
    return {
        name: {
            "messages": found.messages,
            "rate_hz": found.rate_hz,
            "nominal_hz": found.nominal_hz,
            "timeout_s": None if found.lateness is None else found.lateness.timeout_s,
            "late_share": None if found.lateness is None else found.lateness.late_share,
            "late_spans": None if found.lateness is None else found.lateness.late_spans,
            "spans": [asdict(span) for span in found.spans],
        }
        for name, found in health.items()
    }
