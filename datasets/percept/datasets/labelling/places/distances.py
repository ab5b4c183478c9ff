"""How near the places of one part of a data set are to those of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from percept.core.errors import GeometryError
from percept.datasets.labelling.labelled_set import SPLITS, LabelledSet

__all__ = ["Nearest", "least_distances", "nearest_across"]

_AXIS_M = 6378137.0
_SQUARED_ECCENTRICITY = 6.69437999014e-3


class Nearest(NamedTuple):
    """Of each place of one part, the nearest place of another.

    Attributes:
        part: The part.
        other: The other part.
        places: (N,) numbers of the places of `part`.
        nearest: (N,) numbers of the places of `other` that are nearest to them.
        distances_m: (N,) how far these are.
    """

    part: str
    other: str
    places: NDArray[np.intp]
    nearest: NDArray[np.intp]
    distances_m: NDArray[np.float64]


def nearest_across(
    latitudes: ArrayLike, longitudes: ArrayLike, splits: Sequence[str]
) -> Iterator[Nearest]:
    """Yield for each two parts that have places how near they come to each other.

    Distances are straight lines between places on the ellipsoid WGS 84; over some kilometres that
    is the way over the ground.

    Args:
        latitudes: (N,) degrees north; NaN where not known.
        longitudes: (N,) degrees east; NaN where not known.
        splits: N names of parts; others than `SPLITS` do not count.

    Raises:
        GeometryError: If the three are not of one length.
    """
    latitude = np.asarray(latitudes, dtype=np.float64)
    longitude = np.asarray(longitudes, dtype=np.float64)
    names = np.array(splits, dtype=object)
    if not latitude.shape == longitude.shape == names.shape:
        raise GeometryError(f"{len(names)} places need as many latitudes and longitudes")
    known = np.isfinite(longitude) & (np.abs(latitude) <= 90.0)
    held = {split: np.flatnonzero(known & (names == split)) for split in SPLITS}
    for other, part in combinations((split for split in SPLITS if len(held[split])), 2):
        tree = KDTree(_on_ellipsoid(latitude[held[other]], longitude[held[other]]))
        here = held[part]
        distances_m, found = tree.query(_on_ellipsoid(latitude[here], longitude[here]))
        yield Nearest(part, other, here, held[other][found], np.asarray(distances_m))


def least_distances(labelled: LabelledSet) -> Mapping[tuple[str, str], float]:
    """Return the least distance in metres between the places of each two parts of a set."""
    moments = labelled.keyframes
    across = nearest_across(
        [one.latitude for one in moments],
        [one.longitude for one in moments],
        [one.split for one in moments],
    )
    return {(one.other, one.part): float(one.distances_m.min()) for one in across}


def _on_ellipsoid(latitude: NDArray[np.float64], longitude: NDArray[np.float64]) -> ArrayLike:
    """Return points (N, 3) in metres, fixed to the earth (WGS 84)."""
    phi, lam = np.radians(latitude), np.radians(longitude)
    radius = _AXIS_M / np.sqrt(1 - _SQUARED_ECCENTRICITY * np.sin(phi) ** 2)
    across = radius * np.cos(phi)
    along = radius * (1 - _SQUARED_ECCENTRICITY) * np.sin(phi)
    return np.column_stack([across * np.cos(lam), across * np.sin(lam), along])
