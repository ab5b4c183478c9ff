"""Lane markings of ASAM OpenDRIVE files (.xodr), versions 1.1 to 1.8."""

from __future__ import annotations

from percept.hdmap.opendrive.load import OpenDriveMap, is_opendrive, load_opendrive

__all__ = ["OpenDriveMap", "is_opendrive", "load_opendrive"]
