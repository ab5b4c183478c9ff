"""Which jobs a log has the sensors for, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from percept.datasets.inspection.sensors import CameraSummary, GnssSummary, LidarSummary
from percept.datasets.inspection.topics import TopicReport

__all__ = ["Use", "judge_uses"]

_SCANS_FOR_ODOMETRY = 10
_POSITION_KINDS = ("odometry", "pose")


@dataclass(frozen=True, slots=True)
class Use:
    """One job.

    Attributes:
        job: The command, or the part of it.
        usable: Whether the log has what it needs.
        why: What it would use, and with what reserve; or what is missing.
    """

    job: str
    usable: bool
    why: str


def judge_uses(topics: Sequence[TopicReport], frames_known: frozenset[str]) -> tuple[Use, ...]:
    """Return one line for each job.

    Args:
        topics: All topics.
        frames_known: Names of the frames of the log's tree.
    """
    lidars = [t for t in topics if isinstance(t.sensor, LidarSummary) and t.sensor.points > 0]
    cameras = [t for t in topics if isinstance(t.sensor, CameraSummary)]
    return (
        _detect_lidar(lidars, frames_known),
        _detect_camera(cameras),
        _calib_lidar(lidars),
        _calib_camera(cameras),
        _calib_camera_lidar(cameras, lidars),
        _odometry(lidars),
        _map_validate(cameras, topics),
    )


def _yes(job: str, why: str) -> Use:
    return Use(job, usable=True, why=why)


def _no(job: str, why: str) -> Use:
    return Use(job, usable=False, why=why)


def _detect_lidar(lidars: list[TopicReport], frames_known: frozenset[str]) -> Use:
    job = "detect (LiDAR)"
    if not lidars:
        return _no(job, "no topic with point clouds that can be read")
    reserves = []
    if any(isinstance(t.sensor, LidarSummary) and t.sensor.intensity is None for t in lidars):
        reserves.append("some without intensity: classes by size only")
    if any(t.frame not in frames_known for t in lidars):
        reserves.append("mounting not in tf: give --rig, or it is estimated")
    return _yes(job, "; ".join([_names(lidars), *reserves]))


def _detect_camera(cameras: list[TopicReport]) -> Use:
    job = "detect (camera)"
    if not cameras:
        return _no(job, "no topic with images that can be read")
    return _yes(job, f"{_names(cameras)}; needs a model (--model)")


def _calib_lidar(lidars: list[TopicReport]) -> Use:
    if len(lidars) < 2:
        return _no("calib lidar", f"needs two LiDARs, the log has {len(lidars)}")
    if not _overlap(lidars[0], *lidars[1:]):
        return _no("calib lidar", "the LiDARs were never recorded at the same time")
    return _yes("calib lidar", _names(lidars))


def _calib_camera(cameras: list[TopicReport]) -> Use:
    if not cameras:
        return _no("calib camera", "no topic with images that can be read")
    return _yes("calib camera", f"{_names(cameras)}; a board must be in view")


def _calib_camera_lidar(cameras: list[TopicReport], lidars: list[TopicReport]) -> Use:
    job = "calib camera-lidar"
    if not cameras or not lidars:
        lacking = "images" if lidars else "point clouds" if cameras else "images and point clouds"
        return _no(job, f"no topic with {lacking} that can be read")
    if not any(_overlap(camera, lidar) for camera in cameras for lidar in lidars):
        return _no(job, "camera and LiDAR were never recorded at the same time")
    reserve = "" if _calibrated(cameras) else "; needs --intrinsics, CameraInfo gives none"
    return _yes(job, f"a board must be in view of both{reserve}")


def _odometry(lidars: list[TopicReport]) -> Use:
    long = [t for t in lidars if t.count >= _SCANS_FOR_ODOMETRY]
    if not long:
        if not lidars:
            return _no("odometry", "no topic with point clouds that can be read")
        scans = max(t.count for t in lidars)
        return _no("odometry", f"needs {_SCANS_FOR_ODOMETRY} scans, the log has {scans}")
    timed = any(isinstance(t.sensor, LidarSummary) and t.sensor.scan_s is not None for t in long)
    reserve = "" if timed else "; no per-point times, so scans stay skewed by the motion"
    return _yes("odometry", f"{_names(long)}{reserve}")


def _map_validate(cameras: list[TopicReport], topics: Sequence[TopicReport]) -> Use:
    job = "map validate"
    places = [
        t
        for t in topics
        if t.count
        and (
            t.kind in _POSITION_KINDS
            or (isinstance(t.sensor, GnssSummary) and t.sensor.fix_share > 0)
        )
    ]
    if not cameras:
        return _no(job, "no topic with images that can be read")
    if not places:
        return _no(job, "nothing says where the car is (no GNSS fix, odometry or pose)")
    reserve = "" if _calibrated(cameras) else "; needs --rig, CameraInfo gives no intrinsics"
    return _yes(job, f"{_names(cameras)}; position from {_names(places)}{reserve}")


def _calibrated(cameras: list[TopicReport]) -> bool:
    return any(
        isinstance(t.sensor, CameraSummary)
        and t.sensor.info_topic is not None
        and t.sensor.info_problem is None
        for t in cameras
    )


def _overlap(first: TopicReport, *others: TopicReport) -> bool:
    """Return whether any of the others was recorded while the first was."""
    if first.first_ns is None or first.last_ns is None:
        return False
    return any(
        t.first_ns is not None
        and t.last_ns is not None
        and t.first_ns <= first.last_ns
        and first.first_ns <= t.last_ns
        for t in others
    )


def _names(topics: Sequence[TopicReport]) -> str:
    shown = ", ".join(t.topic for t in topics[:4])
    return shown + (f" and {len(topics) - 4} more" if len(topics) > 4 else "")
