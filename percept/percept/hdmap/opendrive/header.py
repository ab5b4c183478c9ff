"""Where an OpenDRIVE file says that it lies: proj strings of transverse Mercator grids."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from percept.hdmap.georeference import Georeference
from percept.hdmap.opendrive.document import Numbers
from percept.hdmap.transverse_mercator import TransverseMercator, georeference_of_grid

__all__ = ["header_offset", "read_georeference"]

_F64 = NDArray[np.float64]
_ELLIPSOIDS = ("WGS84", "GRS80")
_UNKNOWN = "georeference that is no transverse Mercator grid on WGS 84: where the map lies"


def header_offset(root: etree._Element, points: _F64, numbers: Numbers) -> _F64:
    """Return points (N, 3) of a file in the grid of its georeference: turned, then shifted."""
    offset = root.find("header/offset")
    if offset is None:
        return points
    x, y, z, turn = numbers.numbers(offset, "x y z hdg")
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    placed: _F64 = points @ turned.T + (x, y, z)
    return placed


def read_georeference(
    root: etree._Element, points: _F64, dropped: Counter[str]
) -> Georeference | None:
    """Return where a file lies on the earth by its `geoReference`; None counts what is not known.

    Args:
        root: Of the file.
        points: (N, 3) float64 of the map, in the grid.
        dropped: Takes a georeference that is not understood.
    """
    text = (root.findtext("header/geoReference") or "").strip()
    if not text:
        return None
    grid = _grid(text)
    found = georeference_of_grid(grid, points) if grid and len(points) else None
    if found is None:
        dropped[_UNKNOWN] += 1
    return found


def _grid(text: str) -> TransverseMercator | None:
    parts = (word[1:].partition("=") for word in text.split() if word.startswith("+"))
    words = {name: value for name, _, value in parts}
    on_wgs84 = words.get("datum", words.get("ellps", "WGS84")) in _ELLIPSOIDS
    if not on_wgs84 or words.get("units", "m") != "m":
        return None
    try:
        if words.get("proj") == "utm":
            zone = int(words["zone"])
            return TransverseMercator.utm(zone, south="south" in words) if 0 < zone < 61 else None
        if words.get("proj") == "tmerc":
            scale = float(words.get("k_0", words.get("k", "1")))
            latitude, longitude, east, north = (
                float(words.get(name, "0")) for name in ("lat_0", "lon_0", "x_0", "y_0")
            )
            return TransverseMercator(latitude, longitude, scale, east, north)
    except (KeyError, ValueError):
        return None
    return None
