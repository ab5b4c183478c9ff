"""Where the vehicle was: poses that the detections of a run can be placed with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from percept.cli.detect.plan import RunPlan
from percept.cli.odometry.found import FoundPoses
from percept.cli.odometry.request import Source
from percept.cli.odometry.sources import PoseFinder
from percept.core.errors import InputError, InsufficientDataError
from percept.core.results import Verdict
from percept.datasets.recording import Recording

__all__ = ["describe_poses", "find_poses"]


def find_poses(
    recording: Recording, plan: RunPlan, wanted: Source, check_interrupt: Callable[[], None]
) -> tuple[FoundPoses | None, list[str]]:
    """Return where the vehicle was, or None where nothing tells, and what to know of it.

    Poses of the log come first; where they are no use, the LiDAR tells.

    Args:
        recording: The log.
        plan: What was settled.
        wanted: What the poses are to be made from.
        check_interrupt: Raises `KeyboardInterrupt` if Ctrl-C was pressed.

    Raises:
        PerceptError: If the one source that was asked for gives no poses.
    """
    if plan.lidars is None and plan.hd_map is None:
        return None, []
    finder = PoseFinder(
        recording,
        plan.rig,
        plan.config.odometry,
        source=wanted,
        window_ns=plan.window_ns,
        origin=None if plan.hd_map is None else plan.hd_map.origin,
        check_interrupt=check_interrupt,
    )
    ways: list[Callable[[], FoundPoses]] = [finder.find]
    if wanted == "auto" and plan.lidars is not None:
        ways.append(finder.by_lidar)
    notes: list[str] = []
    for way in ways:
        try:
            found = way()
        except (InputError, InsufficientDataError) as error:
            if wanted != "auto":
                raise
            notes.append(f"No poses: {error}.")
            continue
        why = _why_useless(found, _useful_frames(plan))
        if why is None:
            return found, notes
        notes.append(f"Poses from {found.source} are not used: {why}.")
        if found.source == "lidar":
            break
    return None, notes


def describe_poses(found: FoundPoses) -> dict[str, Any]:
    """Return what `run.json` says of poses."""
    return {
        "source": found.source,
        "frame": found.trajectory.target,
        "child_frame": found.trajectory.source,
        "poses": len(found.trajectory),
        "gaps": len(found.trajectory.gaps_ns),
        "verdict": str(found.verdict),
        "why": list(found.why),
        "notes": list(found.notes),
        "dropped": dict(found.dropped),
    }


def _why_useless(found: FoundPoses, frames: frozenset[str]) -> str | None:
    if found.verdict is Verdict.BAD:
        return "; ".join(found.why)
    if found.trajectory.source not in frames:
        return f"no place of a sensor in frame '{found.trajectory.source}' is known"
    return None


def _useful_frames(plan: RunPlan) -> frozenset[str]:
    """Return the frames from which detections can be brought into that of poses."""
    if plan.lidars is not None:
        return frozenset(plan.lidars.frame_of(name) for name in plan.lidars.detectors)
    cameras = plan.cameras.cameras.values() if plan.cameras is not None else ()
    places = [camera.T_base_sensor for camera in cameras]
    return frozenset(place.target for place in places if place is not None)
