"""The places that were given, compared with those that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from percept.calib.lidars.free_space import Agreement, agreement, what_is_seen
from percept.calib.lidars.levelling import find_planes
from percept.calib.lidars.registration import surface
from percept.calib.lidars.rig_graph import relative_motion
from percept.calib.lidars.scenes import CalibrationScenes
from percept.calib.limits import LidarLimits

__all__ = ["exchanged_names", "worse_than_start"]

_F64 = NDArray[np.float64]

_VOXEL_M = 0.2
_ARM_M = 1.0  # a turn is weighed by what it moves 1 m away


def exchanged_names(
    poses: Mapping[str, _F64], start: Mapping[str, _F64], limits: LidarLimits
) -> dict[str, str]:
    """Return the sensors that were found where another one was given to be, and why.

    Args:
        poses: `T_reference_sensor` (4, 4) that were found, the reference's included.
        start: Those that were given, likewise.
        limits: How far a place has to be off to count.
    """
    names = [name for name in poses if name in start]
    found: dict[str, str] = {}
    for a, b in combinations(names, 2):
        own, other = _distances(a, b, poses, start)
        if own > limits.exchanged_off_m and other < limits.exchanged_share * own:
            why = f"'{a}' and '{b}' were found where the given rig has the other one"
            found |= {name: why for name in (a, b) if not _is_reference(poses[name])}
    return found


def _distances(
    a: str, b: str, poses: Mapping[str, _F64], start: Mapping[str, _F64]
) -> tuple[float, float]:
    """Return how far two sensors are from their own given places, and from the other's (m)."""
    found_a_b, given_a_b = _between(a, b, poses), _between(a, b, start)
    exchanged = _apart(found_a_b, _between(b, a, start))
    if not (_is_reference(poses[a]) or _is_reference(poses[b])):
        exchanged = max(_apart(poses[a], start[b]), _apart(poses[b], start[a]))
        return max(_apart(poses[a], start[a]), _apart(poses[b], start[b])), exchanged
    return _apart(found_a_b, given_a_b), exchanged


def _between(a: str, b: str, poses: Mapping[str, _F64]) -> _F64:
    """Return `T_a_b`."""
    return np.asarray(np.linalg.inv(poses[a]) @ poses[b], dtype=np.float64)


def _is_reference(T_reference_sensor: _F64) -> bool:
    return bool(np.array_equal(T_reference_sensor, np.eye(4)))


def _apart(T: _F64, other: _F64) -> float:
    motion = relative_motion(T, other)
    return float(np.linalg.norm(motion[3:]) + _ARM_M * np.linalg.norm(motion[:3]))


def worse_than_start(
    path: Sequence[str],
    poses: Mapping[str, _F64],
    scenes: CalibrationScenes,
    start: Mapping[str, _F64],
    limits: LidarLimits,
) -> tuple[str, str] | None:
    """Return why, and what to do, if the clouds speak against a result and for its start.

    By all measures at once: points that meet surfaces on structure, points that meet surfaces
    anywhere, and points where the other sensor saw nothing.

    Args:
        path: Names from the reference to the sensor.
        poses: What was found.
        scenes: The clouds.
        start: What was given.
        limits: By how much a measure has to be worse.
    """
    neighbour, name = path[-2:]
    if neighbour not in start or name not in start:
        return None
    found, given = _between(neighbour, name, poses), _between(neighbour, name, start)
    after, before = Agreement(), Agreement()
    for target, source in scenes.of(neighbour, name):
        seen = [
            what_is_seen(points, surface(points, _VOXEL_M), find_planes(points, 1))
            for points in (target, source)
        ]
        after += agreement(seen[0], seen[1], found)
        before += agreement(seen[0], seen[1], given)
    losses = (
        before.share - after.share,
        before.overlap - after.overlap,
        after.violation - before.violation,
    )
    if min(losses) < limits.worse_than_start:
        return None
    return (
        f"worse than the given start: {after.share:.0%} of the points meet a surface instead of "
        f"{before.share:.0%}, {after.violation:.0%} contradict what was seen instead of "
        f"{before.violation:.0%}",
        "Keep the rig that was given",
    )
