"""When sensors and detectors were late, as lanes over time."""

from __future__ import annotations

from collections.abc import Mapping

import rerun as rr

from percept.core.health import StreamHealth
from percept.export.canvas import Rgb
from percept.export.view.stream import ViewStream

__all__ = ["draw_health"]

_COLOURS: dict[str, Rgb] = {"in time": (32, 120, 84), "late": (222, 56, 49)}


def draw_health(stream: ViewStream, health: Mapping[str, StreamHealth]) -> None:
    """Draw a lane for each stream: in time or late, and why in the notes.

    Args:
        stream: The view.
        health: By name of the sensor or detector.
    """
    for name, found in health.items():
        at = rr.new_entity_path(["states", "health", name])
        colours = rr.StateConfiguration(values=list(_COLOURS), colors=[*_COLOURS.values()])
        stream.log(at, colours, static=True)
        stream.set_time(found.start_ns)
        stream.log(at, rr.StateChange(state="in time"))
        for span in found.spans:
            stream.set_time(span.start_ns)
            stream.log(at, rr.StateChange(state="late"))
            stream.note(f"{name} is late: {span.reason}", level="WARN")
            if span.end_ns < found.end_ns:
                stream.set_time(span.end_ns)
                stream.log(at, rr.StateChange(state="in time"))
