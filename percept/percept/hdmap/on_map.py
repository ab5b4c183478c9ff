"""Whether a drive lies on a map at all: one that is kilometres away has another origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from percept.core.errors import InputError
from percept.hdmap.map import HdMap

__all__ = ["check_near", "check_on_map"]

_FAR_M = 100.0


def check_on_map(hd_map: HdMap, positions_map: NDArray[np.float64], where: str) -> float:
    """Return how far the nearest of some positions is from a map, metres.

    Args:
        hd_map: The map.
        positions_map: (N, 3) float64 in the map frame, such as those of a drive.
        where: What they are of, for the message: a file or a topic.

    Raises:
        InputError: If none is within 100 m of the map, or there are none; the message says how
            far they are.
    """
    if not len(positions_map):
        raise InputError("has no positions to find on the map", where=where)
    nearest_m = float(hd_map.distance_m(positions_map).min())
    check_near(nearest_m, where)
    return nearest_m


def check_near(nearest_m: float, where: str) -> None:
    """Refuse a drive that is not on a map.

    Args:
        nearest_m: Its least distance from the map.
        where: What is so far away, for the message.

    Raises:
        InputError: If that is over 100 m; the message says how far it is.
    """
    if nearest_m > _FAR_M:
        far = f"{nearest_m / 1000:,.1f} km" if nearest_m >= 1000 else f"{nearest_m:.0f} m"
        raise InputError(
            f"is not on the map: it comes no nearer than {far}",
            where=where,
            remedy="Check that it is the map of this drive, and the origin of its frame (--origin)",
        )
