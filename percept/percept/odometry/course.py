"""The vehicle's poses from GNSS alone: a smoothed track, headed as it goes.

A Kalman filter and smoother of nearly constant velocity (Bar-Shalom, Li, Kirubarajan 2001,
section 6.2.2) over the fixes. A car points where it goes, so its heading is the course; while it
stands it keeps the last or the next one. Roll and pitch are taken as zero.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from percept.core.clock import NS_PER_S
from percept.core.errors import InsufficientDataError
from percept.core.navigation import NavigationTopics
from percept.core.results import Verdict
from percept.core.trajectory import Trajectory
from percept.odometry.filter_config import FilterConfig
from percept.odometry.fixes import Fixes
from percept.odometry.health import breaks_of, find_gaps, find_jumps
from percept.odometry.poses import VehiclePoses

__all__ = ["course_poses", "courses_of", "smooth_track"]

_F = NDArray[np.float64]
# White acceleration of a car, m^2/s^3: about 1 m/s^2 that lasts 2 s; up and down far less.
_ACCELERATION_PSD = np.diag([4.0, 4.0, 0.25])
_START_SPEED_SD_MPS = 30.0
_LEAST_SPEED_MPS, _MOST_COURSE_SD_RAD = 1.0, 0.3
_SLIP_SD_RAD, _STANDING_SD_RAD, _TILT_SD_RAD = 0.03, 0.1, 0.04
_MOST_REFUSED, _BAD_REFUSED, _MOST_HEADING_SD_RAD = 0.05, 0.25, np.radians(3.0)


def course_poses(topics: NavigationTopics, fixes: Fixes, config: FilterConfig) -> VehiclePoses:
    """Return poses at the fixes that agree with each other.

    Args:
        topics: Where the antenna sits.
        fixes: Fixes in a local frame.
        config: Settings.

    Raises:
        InsufficientDataError: If the vehicle never moves: then it has no heading.
    """
    times_s = (fixes.stamps_ns - fixes.stamps_ns[0]) / NS_PER_S
    states, covariances, used = smooth_track(times_s, fixes.points_m, fixes.covariances_m2, config)
    stamps_ns, dropped = fixes.stamps_ns[used], Counter(fixes.dropped)
    if not used.all():
        dropped["GNSS fixes refused as outliers"] += int((~used).sum())
    yaw, sd_yaw = _held(times_s[used], *courses_of(states[used], covariances[used]))
    matrices = np.broadcast_to(np.eye(4), (len(yaw), 4, 4)).copy()
    cos, sin = np.cos(yaw), np.sin(yaw)
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1] = cos, -sin, sin, cos
    antenna = np.zeros(3) if topics.T_base_gnss is None else topics.T_base_gnss.translation_m
    matrices[:, :3, 3] = states[used, :3] - matrices[:, :3, :3] @ antenna
    spread = np.trace(covariances[used, :3, :3], axis1=1, axis2=2)
    spread += float(antenna[:2] @ antenna[:2]) * sd_yaw**2
    spread += 2 * (antenna[2] * _TILT_SD_RAD) ** 2
    gaps_ns = find_gaps(stamps_ns)
    jumps = find_jumps(stamps_ns, matrices, gaps_ns)
    why = _why(used, sd_yaw, fixes, config)
    if jumps:
        why = (*why, f"jumps: {len(jumps)}")
    return VehiclePoses(
        trajectory=Trajectory(
            fixes.frame, topics.base_frame, stamps_ns, matrices, breaks_of(gaps_ns, jumps)
        ),
        source="gnss",
        origin=fixes.origin,
        sd_position_m=np.sqrt(spread),
        sd_heading_rad=sd_yaw,
        gaps_ns=gaps_ns,
        jumps=jumps,
        notes=("roll and pitch are taken as zero, and the car as driven forwards",),
        dropped=dropped,
        verdict=Verdict.BAD if (~used).mean() > _BAD_REFUSED else Verdict.DOUBTFUL,
        why=why,
    )


def smooth_track(
    times_s: _F, points_m: _F, covariances_m2: _F, config: FilterConfig
) -> tuple[_F, _F, NDArray[np.bool_]]:
    """Return place and velocity (F, 6), covariances (F, 6, 6), and (F,) which fixes were used.

    Args:
        times_s: (F,) rising.
        points_m: (F, 3) fixes.
        covariances_m2: (F, 3, 3) of the fixes.
        config: Settings of the gate.
    """
    count = len(times_s)
    x, P = np.zeros((count, 6)), np.zeros((count, 6, 6))
    ahead, P_ahead, steps = np.zeros((count, 6)), np.zeros((count, 6, 6)), np.zeros((count, 6, 6))
    x[0, :3] = points_m[0]
    P[0, :3, :3] = covariances_m2[0]
    P[0, 3:, 3:] = _START_SPEED_SD_MPS**2 * np.eye(3)
    used, refused_since = np.ones(count, dtype=bool), np.inf
    for n in range(1, count):
        F, Q = _motion(times_s[n] - times_s[n - 1])
        ahead[n], P_ahead[n], steps[n] = F @ x[n - 1], F @ P[n - 1] @ F.T + Q, F
        residual = points_m[n] - ahead[n, :3]
        S = P_ahead[n, :3, :3] + covariances_m2[n]
        used[n] = residual @ np.linalg.solve(S, residual) <= config.gate_chi2
        refused_since = np.inf if used[n] else min(refused_since, times_s[n])
        if times_s[n] - refused_since >= config.recover_s:
            P_ahead[n, :3, :3] += float(residual @ residual) * np.eye(3)
            used[n], refused_since = True, np.inf
        x[n], P[n] = _updated(ahead[n], P_ahead[n], residual, covariances_m2[n], used[n])
    for n in range(count - 2, -1, -1):
        C = np.linalg.solve(P_ahead[n + 1], steps[n + 1] @ P[n]).T
        x[n] += C @ (x[n + 1] - ahead[n + 1])
        P[n] += C @ (P[n + 1] - P_ahead[n + 1]) @ C.T
    return x, P, used


def _motion(dt_s: float) -> tuple[_F, _F]:
    F, Q = np.eye(6), np.zeros((6, 6))
    F[:3, 3:] = dt_s * np.eye(3)
    Q[:3, :3], Q[3:, 3:] = _ACCELERATION_PSD * dt_s**3 / 3, _ACCELERATION_PSD * dt_s
    Q[:3, 3:] = Q[3:, :3] = _ACCELERATION_PSD * dt_s**2 / 2
    return F, Q


def _updated(x: _F, P: _F, residual: _F, covariance: _F, use: np.bool_) -> tuple[_F, _F]:
    if not use:
        return x, P
    K = np.linalg.solve(P[:3, :3] + covariance, P[:3]).T
    keep = np.eye(6)
    keep[:, :3] -= K
    return x + K @ residual, keep @ P @ keep.T + K @ covariance @ K.T


def courses_of(states: _F, covariances: _F) -> tuple[_F, _F]:
    """Return course (rad from x) and its spread (N,); that is infinite where the track stands.

    Args:
        states: (N, 6) place and velocity.
        covariances: (N, 6, 6).
    """
    velocity = states[:, 3:5]
    speed = np.maximum(np.hypot(*velocity.T), 1e-6)
    across = np.column_stack([-velocity[:, 1], velocity[:, 0]]) / speed[:, None]
    sd = np.sqrt(np.einsum("ni,nij,nj->n", across, covariances[:, 3:5, 3:5], across)) / speed
    known = (speed > _LEAST_SPEED_MPS) & (sd < _MOST_COURSE_SD_RAD)
    spread = np.where(known, np.hypot(sd, _SLIP_SD_RAD), np.inf)
    return np.arctan2(velocity[:, 1], velocity[:, 0]), spread


def _held(times_s: _F, course: _F, sd: _F) -> tuple[_F, _F]:
    """Return heading and spread (N,); where the vehicle stands, those of the nearest motion."""
    moving = np.flatnonzero(np.isfinite(sd))
    if not len(moving):
        raise InsufficientDataError("the heading is not known: the vehicle never moves")
    right = np.clip(np.searchsorted(times_s[moving], times_s), 0, len(moving) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.abs(times_s[moving[left]] - times_s) < np.abs(times_s[moving[right]] - times_s)
    source = moving[np.where(nearer, left, right)]
    held = np.where(source == np.arange(len(times_s)), 0.0, _STANDING_SD_RAD)
    return course[source], np.hypot(sd[source], held)


def _why(
    used: NDArray[np.bool_], sd_yaw: _F, fixes: Fixes, config: FilterConfig
) -> tuple[str, ...]:
    why = ["without an IMU nothing checks the fixes, and roll and pitch are not known"]
    if (~used).mean() > _MOST_REFUSED:
        why.append(f"{(~used).mean():.0%} of the fixes contradict the others")
    if np.percentile(sd_yaw, 95) > _MOST_HEADING_SD_RAD:
        why.append(f"the heading is known to {np.degrees(np.percentile(sd_yaw, 95)):.1f} deg only")
    if fixes.median_sd_m() > config.poor_sd_m:
        why.append(f"the fixes are good to {fixes.median_sd_m():.1f} m")
    return tuple(why)
