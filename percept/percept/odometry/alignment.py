"""The first state of the filter: level from gravity, heading from how the vehicle moved.

The heading comes from the course over ground once the vehicle moves, carried back to the start by
the gyroscopes. Forward and backward driving look alike in that; which of them, or the IMU's own
orientation, explains the fixes best is decided by running the filter from each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InsufficientDataError
from percept.core.transform import Transform, rotation_from_rpy
from percept.odometry.course import courses_of, smooth_track
from percept.odometry.filter import start_cost
from percept.odometry.filter_config import FilterConfig
from percept.odometry.filter_kernels import ERRORS, STATE, Drive, turned_since_start

__all__ = ["Start", "find_start"]

_F = NDArray[np.float64]
_VELOCITY_WINDOW_S, _LEVEL_WINDOW_S = 2.0, 10.0
# The vehicle has left its first place when it is so far away; courses of the next minute count.
_AWAY_M, _AWAY_SPREADS = 20.0, 8.0
_COURSES, _APART_S = 3, 10.0
# It stands up to so long before its speed is first told from zero.
_STANDS_MPS, _STANDS_SPREADS, _SURE_S = 0.3, 2.0, 2.0
_FEWEST_STILL, _STILL_BIAS_SD_RADPS = 100, 1e-3
# How far the first guess may be off; an acceleration of 1 m/s^2 tilts "up" by 0.1 rad.
_PLACE_SD_M, _VELOCITY_SD_MPS, _LEVEL_SD_RAD = 1.0, 2.0, 0.1
_ORIENTATION_SD_RAD, _MOST_SD_RAD = 0.1, 0.6
_CONSISTENT_RAD = 0.35
_TRIAL_S = 60.0
# An explanation must be better by a factor of e^5 than a likelier one to be believed.
_MARGIN = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """The first state.

    Attributes:
        state: (21,) see `filter_kernels`.
        covariance: (15, 15) of its error.
        notes: Where the heading came from.
    """

    state: _F
    covariance: _F
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Heading:
    """One opinion on the heading at the start, rad about up from the levelled attitude."""

    name: str
    yaw_rad: float
    sd_rad: float


def find_start(drive: Drive, T_imu_base: Transform, config: FilterConfig) -> Start:
    """Return the state at the first node.

    Raises:
        InsufficientDataError: If the heading cannot be known: the vehicle never moves and the
            IMU tells no orientation.
    """
    courses, starts_s = _courses(drive, config)
    bias, bias_sd = _still_bias(drive, starts_s, config)
    turned = turned_since_start(drive, bias)
    R_level = _levelled(drive, turned, T_imu_base)
    headings, notes = _headings(drive, courses, R_level, turned, bias_sd, T_imu_base)
    if not headings:
        raise InsufficientDataError(
            "the heading is not known: the vehicle never moves, and the IMU tells no orientation"
        )
    trials = [_state(drive, R_level, heading, bias, bias_sd, config) for heading in headings]
    best = 0
    if len(trials) > 1:
        costs = [start_cost(drive, state, spread, _TRIAL_S) for state, spread in trials]
        for n, cost in enumerate(costs):
            best = n if cost < costs[best] - _MARGIN else best
    return Start(*trials[best], (*notes, f"heading at the start from {headings[best].name}"))


def _courses(drive: Drive, config: FilterConfig) -> tuple[list[tuple[float, float, float]], float]:
    """Return time, course (rad from east) and its spread at a few moments of the first motion.

    Of these the surest comes first; there are several because one may hang on fixes that are
    far off. The second result is the time at which the vehicle is first seen to move.
    """
    times = drive.times_s[drive.nodes[drive.fix_of_node >= 0]]
    away = np.linalg.norm(drive.fixes - np.median(drive.fixes[:5], axis=0), axis=1)
    spread = np.sqrt(np.trace(drive.covariances, axis1=1, axis2=2))
    gone = np.flatnonzero(away > np.maximum(_AWAY_M, _AWAY_SPREADS * spread))
    first = times <= (times[gone[0]] if len(gone) else times[-1]) + _TRIAL_S
    track, covariances, _ = smooth_track(
        times[first], drive.fixes[first], drive.covariances[first], config
    )
    course, sd = courses_of(track, covariances)
    found: list[tuple[float, float, float]] = []
    for n in np.argsort(sd, kind="stable").tolist():
        apart = all(abs(times[n] - other[0]) > _APART_S for other in found)
        if np.isfinite(sd[n]) and apart and len(found) < _COURSES:
            found.append((float(times[n]), float(course[n]), float(sd[n])))
    speed = np.linalg.norm(track[:, 3:], axis=1)
    noise = np.sqrt(np.trace(covariances[:, 3:, 3:], axis1=1, axis2=2))
    moving = np.flatnonzero(speed > _STANDS_MPS + _STANDS_SPREADS * noise)
    return found, float(times[moving[0]] if len(moving) else times[-1])


def _still_bias(drive: Drive, starts_s: float, config: FilterConfig) -> tuple[_F, float]:
    """Return what the gyroscopes read while the vehicle stands at the start, and its spread."""
    still = drive.quiet & (drive.times_s[drive.nodes] < starts_s - _SURE_S)
    if still.sum() < _FEWEST_STILL:
        return np.zeros(3), config.gyro_bias_sd_radps
    bias: _F = drive.gyro[drive.nodes[still]].mean(axis=0)
    return bias, min(config.gyro_bias_sd_radps, _STILL_BIAS_SD_RADPS)


def _levelled(drive: Drive, turned: _F, T_imu_base: Transform) -> _F:
    """Return an attitude (3, 3) at the start with the right tilt and the base heading east.

    Up is where the mean force points, over some seconds and in the IMU's first frame; or where
    the IMU's own orientation says.
    """
    if not np.isnan(drive.attitudes[0, 0, 0]):
        up = drive.attitudes[0, 2]
    else:
        first = drive.times_s <= drive.times_s[0] + _LEVEL_WINDOW_S
        up = np.einsum("nij,nj->ni", turned[first], drive.force[first]).mean(axis=0)
    up = up / np.linalg.norm(up)
    ahead = T_imu_base.rotation[:, 0]
    ahead = ahead - (ahead @ up) * up
    ahead = ahead / np.linalg.norm(ahead)
    return np.array([ahead, np.cross(up, ahead), up])


def _headings(
    drive: Drive,
    courses: list[tuple[float, float, float]],
    R_level: _F,
    turned: _F,
    bias_sd: float,
    T_imu_base: Transform,
) -> tuple[list[_Heading], list[str]]:
    """Return opinions on the heading at the start, the one to be preferred first."""
    ahead = T_imu_base.rotation[:, 0]
    forward, backward = [], []
    for time_s, course, sd in courses:
        at = int(np.searchsorted(drive.times_s, time_s))
        yaw = course - _yaw_of(R_level @ turned[at] @ ahead)
        spread = min(float(np.hypot(sd, bias_sd * (time_s - drive.times_s[0]))), _MOST_SD_RAD)
        forward.append(_Heading("the course over ground", yaw, spread))
        backward.append(_Heading("the course over ground, driven backwards", yaw + np.pi, spread))
    opinions = forward + backward
    if np.isnan(drive.attitudes[0, 0, 0]):
        return opinions, []
    own = _Heading(
        "the IMU's orientation", _yaw_of(drive.attitudes[0] @ ahead), _ORIENTATION_SD_RAD
    )
    off = [_wrapped(own.yaw_rad - opinion.yaw_rad) for opinion in opinions]
    if off and min(abs(angle) for angle in off) > _CONSISTENT_RAD:
        degrees = np.degrees(min(off, key=abs))
        note = f"the IMU's own heading is {degrees:.0f} deg from the course: not used"
        return opinions, [note]
    if not off:
        return [own], ["nothing checks the IMU's own heading: the vehicle never moves"]
    return [own, *opinions], []


def _state(
    drive: Drive, R_level: _F, heading: _Heading, bias: _F, bias_sd: float, config: FilterConfig
) -> tuple[_F, _F]:
    times = drive.times_s[drive.nodes[drive.fix_of_node >= 0]]
    first = times <= max(times[0] + _VELOCITY_WINDOW_S, times[min(2, len(times) - 1)])
    place, velocity = _straight_line(times[first] - drive.times_s[0], drive.fixes[first])
    attitude = rotation_from_rpy(0.0, 0.0, heading.yaw_rad) @ R_level
    state = np.zeros(STATE)
    state[0:3] = place - attitude @ drive.antenna
    state[3:6] = velocity
    state[6:15] = attitude.ravel()
    state[18:21] = bias
    sd_fix = np.sqrt(np.trace(drive.covariances[0]))
    # The error of the attitude is in the IMU's frame: that about up lies along `up`.
    up = R_level[2]
    tilt, turn = _LEVEL_SD_RAD**2 * np.eye(3), heading.sd_rad**2 * np.outer(up, up)
    covariance = np.zeros((ERRORS, ERRORS))
    covariance[0:3, 0:3] = (sd_fix**2 + _PLACE_SD_M**2) * np.eye(3)
    covariance[3:6, 3:6] = (sd_fix**2 + _VELOCITY_SD_MPS**2) * np.eye(3)
    covariance[6:9, 6:9] = tilt + turn
    covariance[9:12, 9:12] = config.force_bias_sd_mps2**2 * np.eye(3)
    covariance[12:15, 12:15] = bias_sd**2 * np.eye(3)
    return state, covariance


def _straight_line(times_s: _F, points: _F) -> tuple[_F, _F]:
    """Return place at time 0 and velocity of points (N, 3), though some be far off (Theil, Sen)."""
    a, b = np.triu_indices(len(times_s), 1)
    velocity: _F = np.median((points[b] - points[a]) / (times_s[b] - times_s[a])[:, None], axis=0)
    return np.median(points - times_s[:, None] * velocity, axis=0), velocity


def _yaw_of(direction: _F) -> float:
    return float(np.arctan2(direction[1], direction[0]))


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)
