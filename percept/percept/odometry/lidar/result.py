"""What LiDAR odometry says: the poses of scans, how well each is known, and a verdict."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InsufficientDataError
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.odometry.health import find_gaps

__all__ = ["LidarTrajectory", "ScanQuality", "conclude_lidar"]

_FEWEST_POSES = 2
_MOST_FAILED = 0.1
_MOST_DEGENERATE, _MOSTLY_DEGENERATE = 0.05, 0.5
_SCANS_NAMED = 8
_STILL_M = 1.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanQuality:
    """How one scan was registered.

    Attributes:
        scan: Number of the scan in its stream, from 0.
        stamp_ns: Header stamp of the scan, as it came.
        end_ns: Time of its last point, which its pose belongs to.
        points: Points that were registered, thinned out.
        overlap: Share of them with a point of the local map within half a cell.
        residual_m: Median distance from the surfaces of the local map; NaN where there is none.
        hold: Share of the surfaces that hold the direction which is held least; a third where
            all are held alike, 0 in an empty field or a smooth tunnel.
        degenerate: Whether that is so little that the motion along it is a guess.
        deviation_m: How far the pose is from what the motion before made likely.
        moved_m: How far the vehicle moved since the last scan that was registered.
        sd_position_m: Root of the expected squared error of the position since the start.
        sd_heading_rad: The same of the heading.
        matrix: (4, 4) float64 pose of the base frame at `end_ns`; None where it failed.
        failure: Why it was not registered, or an empty text.
        begins_map: Whether a new map begins here: nothing ties its pose to those before.
    """

    scan: int
    stamp_ns: int
    end_ns: int
    points: int = 0
    overlap: float = 0.0
    residual_m: float = float("nan")
    hold: float = 0.0
    degenerate: bool = False
    deviation_m: float = 0.0
    moved_m: float = 0.0
    sd_position_m: float = 0.0
    sd_heading_rad: float = 0.0
    matrix: NDArray[np.float64] | None = None
    failure: str = ""
    begins_map: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LidarTrajectory:
    """Where the vehicle was, by its LiDAR alone.

    Attributes:
        trajectory: `T_odom_base` at the END of each scan that was registered.
        scan_stamps_ns: (N,) int64 header stamps of the same scans.
        sd_position_m: (N,) float64 root of the expected squared error of the position over all
            three axes; it grows with the way.
        sd_heading_rad: (N,) float64 standard deviation of the heading.
        quality: One for each scan, also for those that failed.
        notes: What a user should know besides, as clauses.
        dropped: Scans that have no pose, by reason.
        verdict: How far the poses can be trusted.
        why: Reasons for the verdict, as clauses.
    """

    trajectory: Trajectory
    scan_stamps_ns: NDArray[np.int64]
    sd_position_m: NDArray[np.float64]
    sd_heading_rad: NDArray[np.float64]
    quality: tuple[ScanQuality, ...]
    notes: tuple[str, ...]
    dropped: Counter[str]
    verdict: Verdict
    why: tuple[str, ...]


def conclude_lidar(
    target: str,
    source: str,
    quality: Sequence[ScanQuality],
    notes: Sequence[str],
    dropped: Counter[str],
) -> LidarTrajectory:
    """Put the poses of all scans together, and judge them.

    Raises:
        InsufficientDataError: If there are fewer than two scans.
    """
    if len(quality) < _FEWEST_POSES:
        raise InsufficientDataError(
            f"{len(quality)} LiDAR scans: a motion needs two or more",
            remedy="; ".join(f"{n} x {reason}" for reason, n in dropped.items()) or None,
        )
    placed = [q for q in quality if q.matrix is not None]
    if not placed:
        raise InsufficientDataError(
            f"none of {len(quality)} LiDAR scans has points enough",
            remedy="Check the range of the LiDAR, and max_range_m and min_range_m",
        )
    stamps_ns = np.array([q.end_ns for q in placed], dtype=np.int64)
    matrices = np.stack([q.matrix for q in placed if q.matrix is not None])
    verdict, why = _judge(quality)
    counted = Counter(dropped)
    counted.update(f"scan that did not register: {q.failure}" for q in quality if q.failure)
    return LidarTrajectory(
        trajectory=Trajectory(target, source, stamps_ns, matrices, _gaps(placed, stamps_ns)),
        scan_stamps_ns=np.array([q.stamp_ns for q in placed], dtype=np.int64),
        sd_position_m=np.array([q.sd_position_m for q in placed]),
        sd_heading_rad=np.array([q.sd_heading_rad for q in placed]),
        quality=tuple(quality),
        notes=(*notes, *_motion_notes(quality)),
        dropped=counted,
        verdict=verdict,
        why=why,
    )


def _gaps(placed: Sequence[ScanQuality], stamps_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (G, 2) intervals that are too long, and those before each new map."""
    begun = [n for n, q in enumerate(placed) if q.begins_map and n > 0]
    over = [(stamps_ns[n - 1], stamps_ns[n]) for n in begun]
    gaps = np.concatenate([find_gaps(stamps_ns), np.array(over, dtype=np.int64).reshape(-1, 2)])
    return np.unique(gaps, axis=0)


def _judge(quality: Sequence[ScanQuality]) -> tuple[Verdict, tuple[str, ...]]:
    failed = [q for q in quality if q.failure]
    maps = sum(q.begins_map for q in quality)
    weak = [q for q in quality if q.degenerate]
    why = []
    if failed:
        why.append(
            f"{len(failed)} of {len(quality)} scans did not register: {_named(failed)} "
            f"({failed[0].failure})"
        )
    if maps > 1:
        why.append(f"the way was lost {maps - 1} x: poses before and after a gap have no relation")
    if weak:
        why.append(
            f"{len(weak)} of {len(quality)} scans have a direction that no surface holds "
            f"(tunnel, open field): {_named(weak)}"
        )
    lost = maps > 1 or len(failed) > _MOST_FAILED * len(quality)
    lost = lost or len(weak) > _MOSTLY_DEGENERATE * len(quality)
    if lost or len(quality) - len(failed) < _FEWEST_POSES:
        return Verdict.BAD, tuple(why)
    if failed or len(weak) > _MOST_DEGENERATE * len(quality):
        return Verdict.DOUBTFUL, tuple(why)
    why.insert(0, f"all {len(quality)} scans registered with the scans before them")
    return Verdict.GOOD, tuple(why)


def _named(scans: Sequence[ScanQuality]) -> str:
    names = ", ".join(str(q.scan) for q in scans[:_SCANS_NAMED])
    more = len(scans) - _SCANS_NAMED
    return f"scans {names}" + (f" and {more} more" if more > 0 else "")


def _motion_notes(quality: Sequence[ScanQuality]) -> list[str]:
    way_m = sum(q.moved_m for q in quality)
    if way_m >= _STILL_M or any(q.failure for q in quality):
        return []
    return [f"the vehicle hardly moves ({way_m:.2f} m)"]
