"""The motion of the vehicle as a log tells it, and scans of a moving vehicle at one instant.

A spinning LiDAR that moves sees each point from another place. Motion from the odometry brings
all points to one instant:

    p(t0) = T_base_sensor^-1  T_odom_base(t0)^-1  T_odom_base(t)  T_base_sensor  p(t)

`T_base_sensor` is what a calibration looks for, so that a start value stands in for it. Let w
be the error of its rotation, m the way and a the turn of the vehicle between t and t0 (half a
scan: 50 ms), and d the error of the lever arm. The point is then wrong by about |w| |m| +
2 |a| |d|: at 8 m/s and 1 deg by 7 mm; at 8 m/s and 5 deg by 35 mm; at a turn of 10 deg/s and a
lever arm wrong by 10 cm by 2 mm. The first term is why static stops are better, and why the
moving scenes of a log should be made again with the calibration that came out of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError
from percept.core.samples import OdometrySample, PointCloud, PoseSample, TransformSample
from percept.core.trajectory import Trajectory
from percept.core.transform import Transform
from percept.datasets.recording import Recording

__all__ = ["at_one_instant", "keyframe_stamps", "read_motion", "stands_still"]

_ODOMETRY_FRAMES = ("odom", "map", "world")
_STILL_WINDOW_NS = 300_000_000
_STILL_M, _STILL_RAD = 0.02, 0.002
_SLOT_NS = 250_000
_FEWEST_POSES = 10
_LONGEST_GAP_NS = 250_000_000


def read_motion(
    recording: Recording, start_ns: int | None = None, end_ns: int | None = None
) -> Trajectory | None:
    """Return the vehicle's poses, or None where the log has none that can be used.

    Odometry is taken first, then poses, then a moving edge of tf that starts at `odom`, `map`
    or `world`; of several topics the one with the most messages.

    Args:
        recording: The log.
        start_ns: First log time.
        end_ns: Last log time.
    """
    infos = sorted(recording.topics(), key=lambda info: -info.count)
    for kind in (OdometrySample, PoseSample, TransformSample):
        for info in infos:
            if info.sample_type is kind and not info.topic.endswith("static"):
                found = _trajectory(recording, info.topic, start_ns, end_ns)
                if found is not None:
                    return found
    return None


def stands_still(motion: Trajectory, stamp_ns: int) -> bool:
    """Return whether the vehicle stands in the 0.3 s around a stamp, by its odometry."""
    first_ns, last_ns = int(motion.stamps_ns[0]), int(motion.stamps_ns[-1])
    half_ns = _STILL_WINDOW_NS // 2
    before = motion.at(min(max(stamp_ns - half_ns, first_ns), last_ns))
    after = motion.at(min(max(stamp_ns + half_ns, first_ns), last_ns))
    if before is None or after is None:
        return False
    moved = before.inverse().matrix @ after.matrix
    return bool(np.linalg.norm(moved[:3, 3]) <= _STILL_M and _angle(moved) <= _STILL_RAD)


def keyframe_stamps(
    motion: Trajectory, stamps_ns: NDArray[np.int64], spacing_m: float, most: int
) -> list[int]:
    """Choose stamps of scans that are some way apart, spread over the whole way.

    Args:
        motion: Poses of the vehicle.
        stamps_ns: (N,) stamps of scans.
        spacing_m: Least way between two.
        most: Largest number.

    Returns:
        Rising stamps inside the span of the motion; empty where there are none.
    """
    margin_ns = 100_000_000
    inside = stamps_ns[
        (stamps_ns >= motion.stamps_ns[0] + margin_ns)
        & (stamps_ns <= motion.stamps_ns[-1] - margin_ns)
    ]
    if not len(inside):
        return []
    places = motion.matrices[:, :3, 3]
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    at = np.interp(inside, motion.stamps_ns, way)
    step = max(spacing_m, (at[-1] - at[0]) / most)
    chosen = [0]
    for n in range(1, len(at)):
        if at[n] - at[chosen[-1]] >= step:
            chosen.append(n)
    return [int(stamp) for stamp in inside[chosen[:most]]]


def at_one_instant(
    cloud: PointCloud, motion: Trajectory, T_base_sensor: Transform, instant_ns: int
) -> NDArray[np.float32]:
    """Return the points (N, 3) of a scan as the sensor would see them at one instant.

    A cloud without a time per point is moved as a whole, from its stamp.

    Raises:
        GeometryError: If the motion does not cover the scan.
    """
    times_ns = np.full(len(cloud), cloud.stamp_ns, dtype=np.int64)
    if cloud.offset_ns is not None:
        times_ns = times_ns + cloud.offset_ns
    points = np.empty((len(cloud), 3), dtype=np.float32)
    _, slots = np.unique(times_ns // _SLOT_NS, return_inverse=True)
    order = np.argsort(slots, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(slots[order])) + 1)
    T_sensor_base = np.linalg.inv(T_base_sensor.matrix)
    T_base_odom = np.linalg.inv(_pose(motion, instant_ns, cloud.topic))
    for part in parts if len(cloud) else ():
        T_odom_base = _pose(motion, int(times_ns[part].mean()), cloud.topic)
        moved = T_sensor_base @ T_base_odom @ T_odom_base @ T_base_sensor.matrix
        points[part] = cloud.points_xyz[part] @ moved[:3, :3].T + moved[:3, 3]
    return points


def _pose(motion: Trajectory, stamp_ns: int, topic: str) -> NDArray[np.float64]:
    pose = motion.at(stamp_ns)
    if pose is None:
        raise GeometryError("the odometry does not cover the scan", where=topic)
    return pose.matrix


def _angle(matrix: NDArray[np.float64]) -> float:
    return float(np.arccos(np.clip((np.trace(matrix[:3, :3]) - 1) / 2, -1.0, 1.0)))


def _trajectory(
    recording: Recording, topic: str, start_ns: int | None, end_ns: int | None
) -> Trajectory | None:
    poses: dict[int, Transform] = {}
    for sample in recording.samples(topics=[topic], start_ns=start_ns, end_ns=end_ns):
        edge = isinstance(sample, TransformSample) and sample.frame in _ODOMETRY_FRAMES
        if isinstance(sample, PoseSample | TransformSample) and (
            edge or isinstance(sample, PoseSample)
        ):
            poses[sample.stamp_ns] = sample.T_frame_child
    stamps = np.array(sorted(poses), dtype=np.int64)
    if len(stamps) < _FEWEST_POSES or np.median(np.diff(stamps)) > _LONGEST_GAP_NS:
        return None
    first = poses[int(stamps[0])]
    matrices = np.stack([poses[stamp].matrix for stamp in stamps.tolist()])
    return Trajectory(first.target, first.source, stamps, matrices)
