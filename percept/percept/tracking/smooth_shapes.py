"""Size and yaw of a tracked object with hindsight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.tracking.filter import wrap_angle
from percept.tracking.history import TrackHistory

__all__ = ["facing_sizes", "size_covariances", "smooth_shapes"]

_F64 = NDArray[np.float64]

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
    seen = as_seen(history)
    yaws = _smooth_yaws(history, seen, still_frame=still_frame)
    sizes = facing_sizes(seen[history.observed], yaws[history.observed])
    shapes = np.empty((len(yaws), 4))
    shapes[:, :3] = _upper_quartile(sizes)
    shapes[:, 3] = yaws
    return shapes


def size_covariances(history: TrackHistory, shapes: _F64) -> _F64:
    """Return what the size leaves open about the centres: covariances (K, 2, 2) in x and y, m^2.

    One side of an object is seen, and the centre lies half of its size behind it. The size is as
    uncertain as the views of it differ. That error is the same in all of them, so no number of
    detections makes it smaller, and the filter, for which all errors are new ones each time, does
    not know of it.

    Args:
        history: A track with shapes as they were seen.
        shapes: (K, 4) its shapes with hindsight.
    """
    seen = history.observed
    parts = facing_sizes(as_seen(history)[seen], shapes[seen, 3])
    along, across = ((parts[:, :2] - shapes[seen, :2]) ** 2).mean(axis=0) / 4
    cosine, sine = np.cos(shapes[:, 3]), np.sin(shapes[:, 3])
    covariances = np.empty((len(shapes), 2, 2))
    covariances[:, 0, 0] = along * cosine**2 + across * sine**2
    covariances[:, 1, 1] = along * sine**2 + across * cosine**2
    covariances[:, 0, 1] = covariances[:, 1, 0] = (along - across) * cosine * sine
    return covariances


def as_seen(history: TrackHistory) -> _F64:
    """Return the shapes (K, 4) of the detections of a track, and its own where there is none."""
    measured = history.measured[:, 3:]
    return np.where(np.isfinite(measured), measured, history.shapes)


def facing_sizes(shapes: _F64, yaws: _F64) -> _F64:
    """Return the length, width and height (N, 3) that shapes (N, 4) have along other yaws (N,).

    A box around an L of points does not know its front: where it is a quarter turn away, its
    length and width change places.
    """
    sizes = shapes[:, :3].copy()
    across = np.abs(np.sin(shapes[:, 3] - yaws)) > np.sqrt(0.5)
    sizes[across, :2] = shapes[across, 1::-1]
    return sizes


def _upper_quartile(values: _F64) -> _F64:
    """Return the upper quartile of each column; `numpy.quantile` takes ten times as long."""
    place = _SIZE_QUANTILE * (len(values) - 1)
    ordered = np.sort(values, axis=0)
    below, above = ordered[int(place)], ordered[min(int(place) + 1, len(values) - 1)]
    quartile: _F64 = below + (place - int(place)) * (above - below)
    return quartile


def _smooth_yaws(history: TrackHistory, seen: _F64, *, still_frame: bool) -> _F64:
    from percept.tracking.smooth_kernels import decayed_sums

    velocities = history.states[:, 3:5]
    speeds = np.hypot(velocities[:, 0], velocities[:, 1])
    courses = np.arctan2(velocities[:, 1], velocities[:, 0])
    course_weights = np.zeros(len(history))
    if still_frame:
        spreads = np.sqrt(history.covariances[:, [3, 4], [3, 4]].max(axis=1))
        moving = speeds > np.maximum(_MOVING_SIGMAS * spreads, _MOVING_MPS)
        sd_rad = np.hypot(_COURSE_SD_RAD, spreads / np.maximum(speeds, _MOVING_MPS))
        course_weights[moving] = 1 / sd_rad[moving] ** 2
    yaws, box_weights = seen[:, 3], _box_weights(seen, history.observed)
    vectors = box_weights * np.exp(2j * yaws) + course_weights * np.exp(2j * courses)
    dt_s = np.diff(history.stamps_ns) / 1e9
    way_m = 0.5 * (speeds[1:] + speeds[:-1]) * dt_s
    mean = decayed_sums(vectors, np.exp(-dt_s / _YAW_MEMORY_S - way_m / _YAW_MEMORY_M))
    smoothed = 0.5 * np.unwrap(np.angle(mean))
    votes = box_weights * np.cos(smoothed - yaws) + course_weights * np.cos(smoothed - courses)
    return wrap_angle(smoothed if votes.sum() >= 0 else smoothed + np.pi)


def _box_weights(seen: _F64, observed: NDArray[np.bool_]) -> _F64:
    length, width = np.maximum(seen[:, :2], 1e-3).T
    area = length * width
    elongation = np.maximum(np.abs(length - width) / (length + width), _LEAST_ELONGATION)
    weights: _F64 = observed * elongation * area / area[observed].max() / _BOX_YAW_SD_RAD**2
    return weights
