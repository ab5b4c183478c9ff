"""What a detector learns from the first clouds of a sensor: mounting, intensity, density."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import GeometryError, InsufficientDataError
from percept.core.samples import PointCloud
from percept.core.transform import Transform
from percept.lidar.classify import load_rules
from percept.lidar.density import estimate_density
from percept.lidar.ground import segment_ground
from percept.lidar.intensity import IntensityScale, estimate_intensity_scale
from percept.lidar.mounting import Mounting, estimate_mounting
from percept.lidar.pipeline import LidarConfig, LidarDetector

__all__ = ["prepare_detector"]


def prepare_detector(
    clouds: Sequence[PointCloud],
    config: LidarConfig | None = None,
    *,
    sensor: str = "",
    T_base_sensor: Transform | None = None,
    merged: bool = False,
) -> LidarDetector:
    """Make the detector of one sensor from its first few clouds.

    Args:
        clouds: About five clouds of one sensor, all in one frame; empty ones are passed over.
        config: Settings; defaults where it is None.
        sensor: Name that the detections carry; the clouds' topic where it is empty.
        T_base_sensor: From the rig, where it is known: its rotation levels the points, so that
            a start on a hill does not count as tilt. Without it the ground plane levels them.
        merged: The clouds come from `merge_clouds`: then there is no one origin from which the
            density of a surface could be told, and the rules go without `fill`.

    Returns:
        A detector for all clouds of that frame.

    Raises:
        InsufficientDataError: If no cloud has a point.
        GeometryError: If there is no ground to be found and `sensor_height_m` is not set, if a
            height cannot be right, or the clouds are in several frames.
    """
    config = config or LidarConfig()
    filled = [cloud for cloud in clouds if len(cloud)]
    if not filled:
        raise InsufficientDataError(
            f"none of the first {len(clouds)} clouds has a finite point",
            where=sensor or (clouds[0].topic if clouds else None),
            remedy="Choose another topic, or a later start with --start",
        )
    detector = LidarDetector(
        config,
        _mounting(filled, config, T_base_sensor),
        load_rules(config.rules),
        sensor=sensor or filled[0].topic,
    )
    return replace(
        detector,
        intensity_scale=_intensity_scale(filled, detector),
        density=None
        if merged
        else estimate_density([detector.levelled(cloud) for cloud in filled]),
    )


def _mounting(
    clouds: Sequence[PointCloud], config: LidarConfig, T_base_sensor: Transform | None
) -> Mounting:
    """Return the mounting by the ground plane; what was given or is known wins over it."""
    frame = clouds[0].frame
    rotation = _known_rotation(config, T_base_sensor)
    turned = np.eye(3) if rotation is None else rotation
    try:
        found = estimate_mounting(
            [c.points_xyz @ turned.T.astype(np.float32) for c in clouds], frame
        )
    except GeometryError:
        if config.sensor_height_m is None:
            raise
        # The user was told to give the height where no plane is found: then the sensor is
        # taken to stand upright, and `clouds_used` says 0.
        return _unseen(frame, turned, config.sensor_height_m)
    if rotation is not None:
        found = replace(found, T_level_sensor=_rotation(frame, rotation))
    if config.sensor_height_m is not None:
        found = replace(found, height_m=config.sensor_height_m)
    return found


def _known_rotation(
    config: LidarConfig, T_base_sensor: Transform | None
) -> NDArray[np.float64] | None:
    """Return the rotation (3, 3) that levels the points; None where the ground must tell it."""
    if not config.level:
        return np.eye(3)
    return None if T_base_sensor is None else T_base_sensor.rotation


def _unseen(frame: str, rotation: NDArray[np.float64], height_m: float) -> Mounting:
    cosine = float(rotation[2, 2])
    return Mounting(
        height_m=height_m,
        found_height_m=float("nan"),
        T_level_sensor=_rotation(frame, rotation),
        tilt_deg=float(np.rad2deg(np.arccos(min(abs(cosine), 1.0)))),
        upside_down=cosine < 0,
        inlier_share=float("nan"),
        sd_height_m=float("nan"),
        clouds_used=0,
    )


def _rotation(frame: str, rotation: NDArray[np.float64]) -> Transform:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return Transform("level", frame, matrix)


def _intensity_scale(
    clouds: Sequence[PointCloud], detector: LidarDetector
) -> IntensityScale | None:
    raw: list[NDArray[np.float32]] = []
    range_m: list[NDArray[np.float32]] = []
    for cloud in clouds:
        if cloud.intensity is None:
            continue
        points = detector.levelled(cloud)
        standing = ~segment_ground(points, detector.ground_config)
        raw.append(cloud.intensity[standing])
        range_m.append(np.linalg.norm(points[standing], axis=1))
    if not raw:
        return None
    return estimate_intensity_scale(
        np.concatenate(raw), np.concatenate(range_m), detector.config.intensity
    )
