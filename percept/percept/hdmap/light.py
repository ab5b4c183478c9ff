"""A traffic light as a map has it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MapLight"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapLight:
    """One traffic light.

    Attributes:
        light_id: Its id in the map.
        corners_map: (4, 3) float64 corners of its face in the map frame, metres: lower left,
            lower right, upper right, upper left as who obeys it sees them.
        facing: (3,) float64 unit vector from the face towards who obeys it.
        bulbs: Colours of its lamps from the top, lamps of one height from the left, such as
            `red`, `yellow`, `green`; empty where the map does not say.
        group_ids: Regulatory elements that it belongs to: lights of one group show the same.
    """

    light_id: int
    corners_map: NDArray[np.float64]
    facing: NDArray[np.float64]
    bulbs: tuple[str, ...] = ()
    group_ids: tuple[int, ...] = ()
