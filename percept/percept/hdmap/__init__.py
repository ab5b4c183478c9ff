"""HD maps: what stands in a Lanelet2 file."""

from __future__ import annotations

from percept.hdmap.light import MapLight
from percept.hdmap.map import HdMap, load_map

__all__ = ["HdMap", "MapLight", "load_map"]
