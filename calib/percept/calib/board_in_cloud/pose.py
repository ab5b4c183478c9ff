"""The pose of a located plate, how well it is known, and where its rim was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from percept.calib.board_in_cloud.judge import Plate

__all__ = ["plate_points", "pose_covariance", "rim_of", "transform_of"]

_RIM_SD = 3.0


def transform_of(plate: Plate) -> NDArray[np.float64]:
    """Return T_lidar_plate (4, 4): x along the width, z towards the sensor."""
    x, y, angle = plate.fit.pose
    c, s = np.cos(angle), np.sin(angle)
    T = np.eye(4)
    T[:3, :3] = plate.rays.axes @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    T[:3, 3] = plate.rays.middle + plate.rays.axes[:, :2] @ np.array([x, y])
    return T


def plate_points(
    plate: Plate, T_lidar_plate: NDArray[np.float64], size_m: tuple[float, float]
) -> NDArray[np.bool_]:
    """Return (K,) which rays of a plate are hits within its sides."""
    inside = np.abs(_on_plate(plate, T_lidar_plate)) < np.array(size_m) / 2
    on: NDArray[np.bool_] = plate.rays.is_hit & inside.all(axis=1)
    return on


def pose_covariance(
    plate: Plate, T_lidar_plate: NDArray[np.float64], size_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Return (6, 6) covariance of a small motion: rotation x, y, z in rad, translation in m.

    Tilt and distance come from the plane's least squares, the rest from the rectangle's
    posterior; the two do not share a measurement to first order.
    """
    on = plate_points(plate, T_lidar_plate, size_m)
    x, y = _on_plate(plate, T_lidar_plate)[on].T
    # A plate turned by (rx, ry) and moved by tz has z = ry's and rx's share at (x, y):
    design = np.column_stack([y, -x, np.ones(len(x))])
    residual = plate.rays.crossings[on, 2]
    variance = float(residual @ residual) / max(len(x) - 3, 1)
    tilt = variance * np.linalg.inv(design.T @ design)
    covariance = np.zeros((6, 6))
    covariance[np.ix_([0, 1, 5], [0, 1, 5])] = tilt
    c, s = np.cos(plate.fit.pose[2]), np.sin(plate.fit.pose[2])
    to_plate = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    in_plane = to_plate @ plate.fit.covariance @ to_plate.T
    covariance[np.ix_([3, 4, 2], [3, 4, 2])] = in_plane
    return covariance


def rim_of(
    plate: Plate, T_lidar_plate: NDArray[np.float64], size_m: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return where the rim passes between neighbouring rays that met and passed the plate.

    Hidden sides have none.

    Returns:
        (K, 3) points in the LiDAR's frame; (K,) sides 0 -x, 1 +x, 2 -y, 3 +y; (K,) standard
        deviations across the side, metres.
    """
    xy = _on_plate(plate, T_lidar_plate)
    half = np.array(size_m) / 2
    outside = (np.abs(xy) - half).max(axis=1)
    rim = _RIM_SD * plate.fit.soft_m  # rays that contradict the fit by more are odd ones
    met = xy[plate.rays.is_hit & (outside < plate.fit.bloom_m + rim) & (outside > -half.min() / 2)]
    past = xy[plate.rays.is_past & (outside > -rim) & (outside < half.min() / 2)]
    if not len(met) or not len(past):
        return np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0)
    nearest_past = cKDTree(past).query(met)[1]
    nearest_met = cKDTree(met).query(past)[1]
    mutual = nearest_met[nearest_past] == np.arange(len(met))
    met, past = met[mutual], past[nearest_past[mutual]]
    middle, gap = (met + past) / 2, np.abs(past - met)
    beyond = np.abs(middle) - half
    axis = np.argmax(beyond, axis=1)
    rows = np.arange(len(middle))
    sign = np.sign(middle[rows, axis])
    middle[rows, axis] -= sign * plate.fit.bloom_m
    side = 2 * axis + (sign > 0)
    seen = ~plate.hidden[side]
    in_lidar = middle @ T_lidar_plate[:3, :2].T + T_lidar_plate[:3, 3]
    sd = np.hypot(gap[rows, axis] / np.sqrt(12.0), plate.fit.soft_m)
    return in_lidar[seen], side[seen], sd[seen]


def _on_plate(plate: Plate, T_lidar_plate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (K, 2) the rays' crossings in the frame of the located plate."""
    in_lidar = plate.rays.crossings[:, :2] @ plate.rays.axes[:, :2].T + plate.rays.middle
    at: NDArray[np.float64] = (in_lidar - T_lidar_plate[:3, 3]) @ T_lidar_plate[:3, :2]
    return at
