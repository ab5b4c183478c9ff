"""Size and yaw of a tracked object with hindsight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.tracking.filter import wrap_angle
from percept.tracking.history import TrackHistory

__all__ = ["facing_sizes", "smooth_shapes"]

_F64 = NDArray[np.float64]
_Complex = NDArray[np.complex128]

_SIZE_QUANTILE = 0.75
_BOX_YAW_SD_RAD = float(np.radians(20))
_LEAST_ELONGATION = 0.1
_COURSE_SD_RAD = float(np.radians(3))
_MOVING_MPS = 0.7
_MOVING_SIGMAS = 3.0
_YAW_MEMORY_S = 10.0
_YAW_MEMORY_M = 3.0


def smooth_shapes(history: TrackHistory, *, still_frame: bool) -> _F64:
    """Return the shapes (K, 4) length, width, height in metres and yaw in rad with hindsight.

    An object does not change its size, and a LiDAR sees more of it at one time than at another,
    never more than there is: its size is the upper quartile of what was seen.

    A box tells its yaw only up to a half turn, and roughly: the more so the more of the object
    it holds and the longer it is. Where the object moves its course tells more. Both are averaged
    as vectors of the doubled angle, each weighted by its precision, with weights that fall with
    the time and with the way between the moments: what stands does not turn. The half turn that
    is left open is chosen once for the whole track.

    Args:
        history: A track with smoothed states, and shapes as they were seen.
        still_frame: Whether the frame is known not to move; otherwise a course says nothing.
    """
    yaws = _smooth_yaws(history, still_frame=still_frame)
    seen = facing_sizes(history.shapes, yaws)[history.observed]
    size = np.quantile(seen, _SIZE_QUANTILE, axis=0)
    return np.column_stack([np.tile(size, (len(yaws), 1)), yaws])


def facing_sizes(shapes: _F64, yaws: _F64) -> _F64:
    """Return the length, width and height (N, 3) that shapes (N, 4) have along other yaws (N,).

    A box around an L of points does not know its front: where it is a quarter turn away, its
    length and width change places.
    """
    sizes = shapes[:, :3].copy()
    across = np.abs(np.sin(shapes[:, 3] - yaws)) > np.sqrt(0.5)
    sizes[across, :2] = shapes[across, 1::-1]
    return sizes


def _smooth_yaws(history: TrackHistory, *, still_frame: bool) -> _F64:
    velocities = history.states[:, 3:5]
    speeds = np.hypot(velocities[:, 0], velocities[:, 1])
    courses = np.arctan2(velocities[:, 1], velocities[:, 0])
    course_weights = np.zeros(len(history))
    if still_frame:
        spreads = np.sqrt(history.covariances[:, [3, 4], [3, 4]].max(axis=1))
        moving = speeds > np.maximum(_MOVING_SIGMAS * spreads, _MOVING_MPS)
        sd_rad = np.hypot(_COURSE_SD_RAD, spreads / np.maximum(speeds, _MOVING_MPS))
        course_weights[moving] = 1 / sd_rad[moving] ** 2
    yaws, box_weights = history.shapes[:, 3], _box_weights(history)
    vectors = box_weights * np.exp(2j * yaws) + course_weights * np.exp(2j * courses)
    dt_s = np.diff(history.stamps_ns) / 1e9
    way_m = 0.5 * (speeds[1:] + speeds[:-1]) * dt_s
    mean = _both_ways(vectors, np.exp(-dt_s / _YAW_MEMORY_S - way_m / _YAW_MEMORY_M))
    smoothed = 0.5 * np.unwrap(np.angle(mean))
    votes = box_weights * np.cos(smoothed - yaws) + course_weights * np.cos(smoothed - courses)
    return wrap_angle(smoothed if votes.sum() >= 0 else smoothed + np.pi)


def _box_weights(history: TrackHistory) -> _F64:
    length, width = np.maximum(history.shapes[:, :2], 1e-3).T
    area = length * width
    elongation = np.maximum(np.abs(length - width) / (length + width), _LEAST_ELONGATION)
    weights: _F64 = history.observed * elongation * area / area.max() / _BOX_YAW_SD_RAD**2
    return weights


def _both_ways(vectors: _Complex, decays: _F64) -> _Complex:
    """Return for each of K vectors the sum of all, each decayed by the K - 1 steps between."""
    before, after = vectors.copy(), vectors.copy()
    for step in range(1, len(vectors)):
        before[step] += decays[step - 1] * before[step - 1]
        after[-1 - step] += decays[-step] * after[-step]
    total: _Complex = before + after - vectors
    return total
