"""What a report says about tracks, lights and health."""

from __future__ import annotations

from collections.abc import Mapping

from percept.cli.track.follow import Followed
from percept.core.health import StreamHealth
from percept.core.trajectory import Trajectory
from percept.export.light_report import LightSummary, light_sections
from percept.export.report import Section
from percept.export.tracking_report import TrackingReport, tracking_sections
from percept.export.tracking_summary import TrackingSummary

__all__ = ["over_time_sections"]


def over_time_sections(
    followed: Followed, poses: Trajectory | None, health: Mapping[str, StreamHealth]
) -> tuple[Section, ...]:
    """Return the sections of a report about all that happens over time.

    Args:
        followed: Tracks and lights.
        poses: Where the vehicle was, or None.
        health: When sensors and detectors were late, by name.
    """
    sections: tuple[Section, ...] = ()
    if followed.drive is not None:
        summary = TrackingSummary()
        for tracks in followed.drive.frames():
            summary.add(tracks)
        sections += tracking_sections(
            TrackingReport(
                summary=summary,
                poses=poses,
                dropped=followed.drive.dropped,
                counts={"gaps that were closed": followed.drive.joined},
            )
        )
    lights = None
    if followed.lights is not None:
        lights = LightSummary()
        for states in followed.lights:
            lights.add(states)
    return (*sections, *light_sections(lights, health))
