"""Which sensors of a rig have a place, and whether a tree of frames can hold them."""

from __future__ import annotations

from collections import Counter

import numpy as np

from percept.core.errors import ConfigError
from percept.core.rig import CameraSensor, LidarSensor, Rig
from percept.core.transform import Transform

__all__ = ["frame_edges", "placed_sensors"]

_SAME_PLACE = 1e-6

Placed = tuple[LidarSensor | CameraSensor, Transform]


def placed_sensors(rig: Rig, notes: Counter[str]) -> list[Placed]:
    """Return the sensors whose place is known, with `T_base_sensor`.

    Args:
        rig: The rig.
        notes: Gets a line for every sensor that is left out.

    Raises:
        ConfigError: If no sensor has a place.
    """
    placed: list[Placed] = []
    for name, sensor in rig.sensors.items():
        if sensor.T_base_sensor is None:
            notes[f"{name} has no T_base_sensor: left out"] += 1
        else:
            placed.append((sensor, sensor.T_base_sensor))
    if not placed:
        raise ConfigError(
            "no sensor of the rig has a T_base_sensor",
            remedy="Calibrate where they sit first: percept calib lidar or camera-lidar",
        )
    return placed


def frame_edges(rig: Rig, notes: Counter[str]) -> list[Placed]:
    """Return the sensors that a tree of frames needs an edge for: one for each frame.

    A sensor in the base frame itself needs none.

    Args:
        rig: The rig.
        notes: Gets a line for every sensor that is left out.

    Raises:
        ConfigError: If no sensor has a place, none is away from the base, or one frame would
            have two places.
    """
    known = {rig.base_frame: np.eye(4)}
    edges: list[Placed] = []
    for sensor, T_base_sensor in placed_sensors(rig, notes):
        earlier = known.get(sensor.frame)
        if earlier is None:
            known[sensor.frame] = T_base_sensor.matrix
            edges.append((sensor, T_base_sensor))
        elif np.abs(T_base_sensor.matrix - earlier).max() > _SAME_PLACE:
            raise ConfigError(
                f"frame '{sensor.frame}' of '{sensor.name}' would have two places",
                remedy="Give each sensor a frame of its own in the rig file",
            )
    if not edges:
        raise ConfigError("the rig has no frame but its base: there is no transform to write")
    return edges
