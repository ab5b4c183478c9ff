"""How well poses are known, as columns of a table and curves of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from percept.cli.odometry.found import FoundPoses
from percept.core.clock import NS_PER_S
from percept.odometry.lidar.result import LidarTrajectory

__all__ = ["break_times", "failed_scans", "over_time", "quality_columns"]

_NONE = float("nan")


def quality_columns(found: FoundPoses) -> dict[str, Sequence[object]]:
    """Return the columns of `quality.parquet` that the source fills."""
    known = found.known
    if not isinstance(known, LidarTrajectory):
        return {
            "stamp_ns": known.trajectory.stamps_ns.tolist(),
            "sd_position_m": known.sd_position_m.tolist(),
            "sd_heading_rad": known.sd_heading_rad.tolist(),
        }
    scans = known.quality
    return {
        "stamp_ns": [q.end_ns for q in scans],
        "scan_stamp_ns": [q.stamp_ns for q in scans],
        "sd_position_m": [_NONE if q.failure else q.sd_position_m for q in scans],
        "sd_heading_rad": [_NONE if q.failure else q.sd_heading_rad for q in scans],
        "points": [q.points for q in scans],
        "overlap": [_NONE if q.begins_map else q.overlap for q in scans],
        "residual_m": [q.residual_m for q in scans],
        "hold": [_NONE if q.begins_map else q.hold for q in scans],
        "deviation_m": [_NONE if q.begins_map else q.deviation_m for q in scans],
        "failure": [q.failure for q in scans],
    }


def over_time(found: FoundPoses) -> tuple[list[float], Mapping[str, Sequence[float]]]:
    """Return times in seconds, and by name the values at them; none where nothing is known."""
    known = found.known
    if isinstance(known, LidarTrajectory):
        scans = known.quality
        return _seconds([q.end_ns for q in scans]), {
            "standard deviation of the position (m)": [
                _NONE if q.failure else q.sd_position_m for q in scans
            ],
            "overlap with the scans before": [_NONE if q.begins_map else q.overlap for q in scans],
            "distance from their surfaces (m)": [q.residual_m for q in scans],
        }
    sds_m = known.sd_position_m.tolist()
    if not any(sd == sd for sd in sds_m):
        return [], {}
    return _seconds(known.trajectory.stamps_ns.tolist()), {
        "standard deviation of the position (m)": sds_m
    }


def break_times(found: FoundPoses) -> list[tuple[float, float]]:
    """Return the start, from the first pose on, and the length of each gap and jump, seconds."""
    first_ns = int(found.trajectory.stamps_ns[0])
    return [
        ((start - first_ns) / NS_PER_S, (end - start) / NS_PER_S)
        for start, end in found.trajectory.gaps_ns.tolist()
    ]


def failed_scans(found: FoundPoses) -> list[tuple[int, float, str]]:
    """Return number, time in seconds and reason of each scan that has no pose."""
    if not isinstance(found.known, LidarTrajectory):
        return []
    scans = found.known.quality
    return [
        (q.scan, (q.end_ns - scans[0].end_ns) / NS_PER_S, q.failure) for q in scans if q.failure
    ]


def _seconds(stamps_ns: Sequence[int]) -> list[float]:
    return [(stamp_ns - stamps_ns[0]) / NS_PER_S for stamp_ns in stamps_ns]
