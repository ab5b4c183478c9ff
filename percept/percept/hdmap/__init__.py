"""HD maps: what stands in a Lanelet2 or an OpenDRIVE file."""

from __future__ import annotations

from percept.hdmap.elements import Lanelet, MapArea, MapMarking, RegulatoryElement
from percept.hdmap.georeference import Georeference
from percept.hdmap.light import MapLight
from percept.hdmap.map import HdMap, load_map
from percept.hdmap.on_map import check_on_map
from percept.hdmap.validate import Validation, ValidationConfig, validate_lanes

__all__ = [
    "Georeference",
    "HdMap",
    "Lanelet",
    "MapArea",
    "MapLight",
    "MapMarking",
    "RegulatoryElement",
    "Validation",
    "ValidationConfig",
    "check_on_map",
    "load_map",
    "validate_lanes",
]
