"""Poses that a log has already: odometry, poses, and a moving transform."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InsufficientDataError
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.odometry.health import Jump, breaks_of, find_gaps, find_jumps
from percept.odometry.poses import PoseSource, VehiclePoses
from percept.odometry.readings import Readings

__all__ = ["path_poses"]

_FEWEST = 2
_NAMELESS = "odom"
_MOST_LOST = 0.1


def path_poses(kind: PoseSource, topics: NavigationTopics, readings: Readings) -> VehiclePoses:
    """Return the poses that a log has of one kind (`odometry`, `pose`, `tf`).

    The followed frame need not be the base: `T_inertial_base = T_inertial_child T_child_base`.

    Raises:
        InsufficientDataError: If there are fewer than two poses.
    """
    column, dropped = readings.paths[kind], Counter(readings.dropped)
    stamps_ns, rows = column.sorted(kind, dropped)
    if len(stamps_ns) < _FEWEST:
        raise InsufficientDataError(f"the log has {len(stamps_ns)} poses of {kind}")
    place = _place(kind, topics)
    matrices = rows.reshape(-1, 4, 4)
    if place is not None:
        matrices = matrices @ place.inverse().matrix
    gaps_ns = find_gaps(stamps_ns)
    jumps = find_jumps(stamps_ns, matrices, gaps_ns)
    target = column.frames[0] or _NAMELESS
    unknown = np.full(len(stamps_ns), np.nan)
    verdict, why = _judge(stamps_ns, gaps_ns, jumps)
    return VehiclePoses(
        trajectory=Trajectory(
            target, topics.base_frame, stamps_ns, matrices, breaks_of(gaps_ns, jumps)
        ),
        source=kind,
        origin=None,
        sd_position_m=unknown,
        sd_heading_rad=unknown,
        gaps_ns=gaps_ns,
        jumps=jumps,
        dropped=dropped,
        verdict=verdict,
        why=why,
    )


def _place(kind: PoseSource, topics: NavigationTopics) -> Transform | None:
    places = {
        "odometry": topics.T_base_odometry,
        "pose": topics.T_base_pose,
        "tf": topics.T_base_tf,
    }
    return places[kind]


def _judge(
    stamps_ns: NDArray[np.int64], gaps_ns: NDArray[np.int64], jumps: tuple[Jump, ...]
) -> tuple[Verdict, tuple[str, ...]]:
    why = []
    if jumps:
        largest = max(jumps, key=lambda jump: jump.moved_m)
        why.append(
            f"jumps: {len(jumps)}, the largest of {largest.moved_m:.2f} m "
            f"{(largest.end_ns - int(stamps_ns[0])) / 1e9:.2f} s after the first pose"
        )
    lost = float(np.diff(gaps_ns, axis=1).sum()) / float(stamps_ns[-1] - stamps_ns[0])
    if lost > _MOST_LOST:
        why.append(f"gaps take {lost:.0%} of the time")
    return (Verdict.DOUBTFUL if why else Verdict.GOOD), tuple(why)
