"""Calibration of LiDARs and cameras that says how good it is.

The solvers are loaded when they are first used: reading a board's definition must not wait
for them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from percept.calib.camera_lidar.calibrate import calibrate_camera_lidar
    from percept.calib.intrinsics.calibrate import calibrate_camera
    from percept.calib.lidars.calibrate import calibrate_lidars

__all__ = ["calibrate_camera", "calibrate_camera_lidar", "calibrate_lidars"]

_HOMES = {
    "calibrate_camera": "intrinsics.calibrate",
    "calibrate_camera_lidar": "camera_lidar.calibrate",
    "calibrate_lidars": "lidars.calibrate",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the module holds
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
