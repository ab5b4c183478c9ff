"""The road's surface inside a lanelet: between its borders it is taken as level across."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.polyline import nearest_place
from percept.hdmap.elements import Lanelet

__all__ = ["surface_height_m"]

_F64 = NDArray[np.float64]


def surface_height_m(lanelet: Lanelet, xy: _F64) -> float:
    """Return the height of a lanelet's surface at a place.

    The height of each border at the place of it that is next, seen from above; between the two a
    straight line. So the surface follows the road's grade and bends, as no plane does.

    Args:
        lanelet: The lanelet.
        xy: The place (2,) in the map frame, in the lanelet or near it.
    """
    (left_m, left_off_m), (right_m, right_off_m) = (
        _border_height_m(border, xy) for border in (lanelet.left_map, lanelet.right_map)
    )
    width_m = left_off_m + right_off_m
    share = left_off_m / width_m if width_m > 0 else 0.5
    return left_m + share * (right_m - left_m)


def _border_height_m(border: _F64, xy: _F64) -> tuple[float, float]:
    """Return the height of a border (K, 3) where it is next to a place, and how far off that is."""
    place = nearest_place(border, xy)
    return float(place[2]), float(np.hypot(*(place[:2] - xy)))
