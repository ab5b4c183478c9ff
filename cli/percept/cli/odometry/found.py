"""Poses of one source, whatever it is, as the run writes and compares them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.odometry.lidar.result import LidarTrajectory
from percept.odometry.poses import VehiclePoses

__all__ = ["FoundPoses", "found_by_lidar", "found_in_log"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FoundPoses:
    """Where the vehicle was, by one source.

    Attributes:
        source: `gnss+imu`, `gnss`, `odometry`, `pose`, `tf` or `lidar`.
        trajectory: `T_inertial_base`.
        known: The same with what the source tells besides.
        jumps: Steps that contradict the motion around them.
        notes: What a user should know besides.
        dropped: What was not used, by reason.
        verdict: How far the poses can be trusted.
        why: Reasons for the verdict.
    """

    source: str
    trajectory: Trajectory
    known: VehiclePoses | LidarTrajectory
    jumps: int = 0
    notes: tuple[str, ...] = ()
    dropped: Counter[str] = field(default_factory=Counter)
    verdict: Verdict = Verdict.GOOD
    why: tuple[str, ...] = ()


def found_in_log(poses: VehiclePoses) -> FoundPoses:
    """Return the poses that a log has already, or that a filter made of its fixes."""
    return FoundPoses(
        source=poses.source,
        trajectory=poses.trajectory,
        known=poses,
        jumps=len(poses.jumps),
        notes=poses.notes,
        dropped=Counter(poses.dropped),
        verdict=poses.verdict,
        why=poses.why,
    )


def found_by_lidar(poses: LidarTrajectory, topic: str, dropped: Counter[str]) -> FoundPoses:
    """Return the poses by LiDAR.

    Args:
        poses: What LiDAR odometry said.
        topic: Topic of its scans.
        dropped: Scans that it never saw, by reason.
    """
    return FoundPoses(
        source="lidar",
        trajectory=poses.trajectory,
        known=poses,
        notes=(f"scans of {topic}; a pose is that of the end of its scan", *poses.notes),
        dropped=Counter(poses.dropped) + dropped,
        verdict=poses.verdict,
        why=poses.why,
    )
