"""LiDAR odometry: each scan is registered to a map of the scans before it.

KISS-ICP (Vizzo, Guadagnino, Mersch, Wiesmann, Behley and Stachniss 2023, "KISS-ICP: In defense
of point-to-point ICP") does the work: its preprocessing, map, threshold and registration are used
as they are. Around them, motion is predicted over time and not over scans, so that a missing scan
does no harm, and a scan is judged before it enters the map: one that does not fit is left out and
named.

The pose of a scan is that of its END. KISS-ICP 1.3.0 moves every point to where it would have
been seen with the last one (measured, and held by a test).
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.errors import GeometryError
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.odometry.lidar.config import LidarOdometryConfig
from percept.odometry.lidar.kiss_parts import KissParts
from percept.odometry.lidar.point_times import ScanTimes, scan_times
from percept.odometry.lidar.result import LidarTrajectory, ScanQuality, conclude_lidar
from percept.odometry.lidar.screw import inverse_motion, part_of_motion
from percept.odometry.lidar.spread import WaySpread
from percept.odometry.lidar.surfaces import MapFit, SurfaceMap

__all__ = ["LidarOdometry", "lidar_trajectory"]

_F = NDArray[np.float64]
_FEWEST_POINTS = 100
# Real keyframes that registered wrongly had an overlap up to 0.32 and residuals from 0.06 cells
# on; those that registered rightly had 0.58 and more, and residuals up to 0.03 cells.
_LEAST_OVERLAP = 0.4
# A map that is left behind goes little by little: one scan keeps this share of what is usual.
_KEPT_OVERLAP, _USUAL_SCANS = 0.6, 10
_LARGEST_RESIDUAL_CELLS = 0.1
# A scan is deskewed once more where the motion that this was done by proves wrong by so much.
_DESKEW_ANEW_M = 0.02
# Rounds in which the first scan and the motion behind it are found from each other.
_SHARPENINGS = 3
# Beyond what a change of speed explains, a pose may be off its prediction by this.
_LOOSE_M = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class _Placed:
    """The last scan that has a pose, and the motion that led to it."""

    end_ns: int
    pose: _F
    motion: _F
    motion_ns: int
    spread: WaySpread

    def expected(self, end_ns: int) -> _F:
        """Return the pose at a later time, if the vehicle goes on as it did."""
        if not self.motion_ns:
            return self.pose
        return self.pose @ part_of_motion(self.motion, (end_ns - self.end_ns) / self.motion_ns)


class _Attempt(NamedTuple):
    """One registration of one scan: the pose, how it fits, and what is wrong with it."""

    pose: _F
    fit: MapFit
    dense: _F
    deviation_m: float
    failure: str


class LidarOdometry:
    """Takes scans in their order and says where the vehicle was at the end of each.

    Args:
        config: Settings.
        T_base_sensor: Where the LiDAR sits; scans in its frame are brought into the base frame,
            and the poses are those of the base. None takes scans as they are.
        frame_id: Name of the frame that poses are given in. It begins at the first scan, or
            lies where the first guess says.

    Attributes:
        frame_id: As given.
        dropped: Scans that could not be looked at, by reason.
    """

    def __init__(
        self,
        config: LidarOdometryConfig | None = None,
        *,
        T_base_sensor: Transform | None = None,
        frame_id: str = "odom",
    ) -> None:
        self.frame_id = frame_id
        self.dropped: Counter[str] = Counter()
        self._config = config or LidarOdometryConfig()
        self._T_base_sensor = T_base_sensor
        self._base_frame = None if T_base_sensor is None else T_base_sensor.target
        self._kiss = KissParts(self._config)
        self._last: _Placed | None = None
        self._first: tuple[_F, ScanTimes] | None = None
        self._scans: list[ScanQuality] = []
        self._failed_in_a_row = 0
        self._overlaps: deque[float] = deque(maxlen=_USUAL_SCANS)
        self._notes: dict[str, None] = {}

    def push(self, cloud: PointCloud, guess: Transform | None = None) -> ScanQuality | None:
        """Register one scan.

        Args:
            cloud: The scan, later than the one before, in the sensor's or the base frame.
            guess: `T_odom_base` at the scan's end, where something else tells it; else the
                motion before is taken to go on. The search begins there, and no more.

        Returns:
            How it went, or None where the scan is no later than the one before (counted).

        Raises:
            GeometryError: If the scan or the guess is in another frame.
        """
        points, times = self._points_base(cloud), scan_times(cloud)
        start = self._checked(guess)
        if times.note:
            self._notes[times.note] = None
        if self._scans and times.end_ns <= self._scans[-1].end_ns:
            self.dropped["scan that is no later than the one before"] += 1
            return None
        blank = ScanQuality(scan=len(self._scans), stamp_ns=cloud.stamp_ns, end_ns=times.end_ns)
        self._scans.append(self._register(blank, points, times, start))
        return self._scans[-1]

    def result(self) -> LidarTrajectory:
        """Return the poses of all scans so far, judged.

        Raises:
            InsufficientDataError: If there are fewer than two scans, or none has enough points.
        """
        base = self._base_frame or "base_link"
        return conclude_lidar(self.frame_id, base, self._scans, [*self._notes], self.dropped)

    def _points_base(self, cloud: PointCloud) -> _F:
        placing = self._T_base_sensor
        if placing is not None and cloud.frame == placing.source:
            return placing.apply(cloud.points_xyz)
        if self._base_frame is None:
            self._base_frame = cloud.frame
        if cloud.frame != self._base_frame:
            raise GeometryError(
                f"a scan in frame '{cloud.frame}' among scans in '{self._base_frame}'",
                where=cloud.topic,
                remedy="Give the place of its LiDAR",
            )
        return cloud.points_xyz.astype(np.float64)

    def _checked(self, guess: Transform | None) -> _F | None:
        if guess is None:
            return None
        if (guess.target, guess.source) != (self.frame_id, self._base_frame):
            raise GeometryError(
                f"a guess is T_{self.frame_id}_{self._base_frame}, "
                f"not T_{guess.target}_{guess.source}"
            )
        return guess.matrix

    def _register(
        self, scan: ScanQuality, points: _F, times: ScanTimes, guess: _F | None
    ) -> ScanQuality:
        last = self._last
        if last is None:
            return self._begin_map(scan, points, times, np.eye(4) if guess is None else guess)
        expected = last.expected(times.end_ns) if guess is None else guess
        tried = self._attempt(last, points, times, expected, guessed=guess is not None)
        if tried.failure:
            self._failed_in_a_row += 1
            if self._failed_in_a_row <= self._config.restart_after:
                return self._told(scan, tried)
            self._kiss.clear()
            self._overlaps.clear()
            return self._begin_map(scan, points, times, expected)
        if self._first is not None and guess is None:
            for _ in range(_SHARPENINGS):
                self._sharpen_first(last, tried, times)
                again = self._attempt(last, points, times, tried.pose, guessed=False)
                tried = tried if again.failure else again
        return self._accept(scan, last, tried, expected)

    def _begin_map(self, scan: ScanQuality, points: _F, times: ScanTimes, pose: _F) -> ScanQuality:
        """Begin a map with a scan; its first motion is not known, so that it is not deskewed."""
        dense, source = self._kiss.thin_out(points, times, np.eye(4))
        if len(source) < _FEWEST_POINTS:
            return replace(scan, points=len(source), failure="too few points")
        self._kiss.add(dense, pose)
        last, spread = self._last, WaySpread()
        if last is not None:
            span_s = (times.end_ns - last.end_ns) / NS_PER_S
            spread = last.spread.after_gap(pose[:3, 3] - last.pose[:3, 3], span_s)
        self._last = _Placed(times.end_ns, pose, np.eye(4), 0, spread)
        self._first, self._failed_in_a_row = (points, times), 0
        return replace(
            scan,
            points=len(source),
            matrix=pose,
            begins_map=True,
            sd_position_m=spread.sd_position_m,
            sd_heading_rad=spread.sd_heading_rad,
        )

    def _attempt(
        self, last: _Placed, points: _F, times: ScanTimes, expected: _F, *, guessed: bool
    ) -> _Attempt:
        """Register a scan; where it fails, once more from as far away as the very first one."""
        dense, source = self._deskewed(last, points, times, expected)
        if len(source) < _FEWEST_POINTS:
            return _Attempt(expected, MapFit.nothing(len(source)), dense, 0.0, "too few points")
        surfaces = SurfaceMap(self._kiss.map_points(), self._config.cell_m)
        tried = _Attempt(expected, MapFit.nothing(), dense, 0.0, "not tried")
        for reach_m in self._kiss.reaches_m():
            pose = self._kiss.align(source, expected, reach_m)
            if np.linalg.norm(pose[:3, 3] - expected[:3, 3]) > _DESKEW_ANEW_M:
                dense, source = self._deskewed(last, points, times, pose)
            pose = surfaces.settle(source, pose)
            fit = surfaces.fit(source, pose)
            deviation_m = float(np.linalg.norm(pose[:3, 3] - expected[:3, 3]))
            jump = "" if guessed else self._jump(last, pose, times.end_ns, deviation_m)
            tried = _Attempt(pose, fit, dense, deviation_m, self._misfit(fit) or jump)
            if not tried.failure:
                break
        return tried

    def _deskewed(self, last: _Placed, points: _F, times: ScanTimes, pose: _F) -> tuple[_F, _F]:
        """Return points for the map and points to register, if the scan ends at a pose."""
        share = times.duration_s * NS_PER_S / (times.end_ns - last.end_ns)
        motion = part_of_motion(inverse_motion(last.pose) @ pose, share)
        return self._kiss.thin_out(points, times, motion)

    def _misfit(self, fit: MapFit) -> str:
        usual = float(np.median(self._overlaps)) if self._overlaps else 0.0
        if fit.overlap < max(_LEAST_OVERLAP, _KEPT_OVERLAP * usual):
            return "too little overlap with the scans before"
        if not fit.residual_m <= _LARGEST_RESIDUAL_CELLS * self._config.cell_m:
            return "surfaces do not meet those of the scans before"
        return ""

    def _jump(self, last: _Placed, pose: _F, end_ns: int, deviation_m: float) -> str:
        """Say which limit of a vehicle's motion a step breaks."""
        config, span_s = self._config, (end_ns - last.end_ns) / NS_PER_S
        motion = inverse_motion(last.pose) @ pose
        cosine = np.clip((np.trace(motion[:3, :3]) - 1) / 2, -1, 1)
        if np.linalg.norm(motion[:3, 3]) > config.max_speed_mps * span_s + _LOOSE_M:
            return f"a jump: faster than {config.max_speed_mps:g} m/s"
        if np.arccos(cosine) > config.max_turn_radps * span_s + 0.02:
            return f"a jump: turns faster than {config.max_turn_radps:g} rad/s"
        if last.motion_ns and deviation_m > config.max_acceleration_mps2 * span_s**2 + _LOOSE_M:
            return f"a jump: changes its speed by more than {config.max_acceleration_mps2:g} m/s^2"
        return ""

    def _sharpen_first(self, last: _Placed, tried: _Attempt, times: ScanTimes) -> None:
        """Make the map anew from its first scan, deskewed by the motion that is now known."""
        if self._first is None:
            return
        points, first = self._first
        motion = inverse_motion(last.pose) @ tried.pose
        share = first.duration_s * NS_PER_S / (times.end_ns - first.end_ns)
        dense, _ = self._kiss.thin_out(points, first, part_of_motion(motion, share))
        self._kiss.clear()
        self._kiss.add(dense, last.pose)

    def _accept(
        self, scan: ScanQuality, last: _Placed, tried: _Attempt, expected: _F
    ) -> ScanQuality:
        self._kiss.learn(inverse_motion(expected) @ tried.pose)
        self._kiss.add(tried.dense, tried.pose)
        self._overlaps.append(tried.fit.overlap)
        told = self._told(scan, tried)
        step = tried.pose[:3, 3] - last.pose[:3, 3]
        span_ns = scan.end_ns - last.end_ns
        spread = last.spread.after(step, span_ns / NS_PER_S, tried.fit)
        motion = inverse_motion(last.pose) @ tried.pose
        self._last = _Placed(scan.end_ns, tried.pose, motion, span_ns, spread)
        self._first, self._failed_in_a_row = None, 0
        return replace(
            told,
            matrix=tried.pose,
            moved_m=float(np.linalg.norm(step)),
            sd_position_m=spread.sd_position_m,
            sd_heading_rad=spread.sd_heading_rad,
        )

    def _told(self, scan: ScanQuality, tried: _Attempt) -> ScanQuality:
        return replace(
            scan,
            points=tried.fit.points,
            overlap=tried.fit.overlap,
            residual_m=tried.fit.residual_m,
            hold=float(tried.fit.hold[0]),
            degenerate=tried.fit.degenerate and not tried.failure,
            deviation_m=tried.deviation_m,
            failure=tried.failure,
        )


def lidar_trajectory(
    clouds: Iterable[PointCloud],
    *,
    config: LidarOdometryConfig | None = None,
    T_base_sensor: Transform | None = None,
    frame_id: str = "odom",
) -> LidarTrajectory:
    """Return where the vehicle was, by its LiDAR alone.

    Args:
        clouds: Scans in their order, in the base frame or all of one LiDAR.
        config: Settings.
        T_base_sensor: Where the LiDAR sits, for scans that are in its frame.
        frame_id: Name of the frame that poses are given in; it begins at the first scan.

    Raises:
        InsufficientDataError: If there are fewer than two scans.
        GeometryError: If scans are in several frames.
    """
    odometry = LidarOdometry(config, T_base_sensor=T_base_sensor, frame_id=frame_id)
    for cloud in clouds:
        odometry.push(cloud)
    return odometry.result()
