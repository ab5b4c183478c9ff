"""Calibrations in the files of other tools: ROS, URDF, Kalibr, KITTI, OpenCV, Autoware."""

from __future__ import annotations

from percept.calib.formats.about import about_rig
from percept.calib.formats.exchange import (
    FIXED_FILES,
    FORMATS,
    export_rig,
    import_rig,
    read_intrinsics,
)

__all__ = ["FIXED_FILES", "FORMATS", "about_rig", "export_rig", "import_rig", "read_intrinsics"]
