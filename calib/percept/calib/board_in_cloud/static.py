"""Which points of several clouds of one standing sensor belong to things that move."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

__all__ = ["moving_points"]

_VOXEL_M = 0.1
_STATIC_SHARE = 0.5
_KEY_BITS = 20  # of a voxel's index along one axis: more than 50 km either way


def moving_points(clouds: Sequence[NDArray[np.float64]]) -> list[NDArray[np.bool_]]:
    """Return, for each cloud (N, 3), which points lie off the places that most clouds hit.

    A place is a voxel of 0.1 m with its 26 neighbours; it is static when more than half of the
    clouds have a point in the voxel. A board that stands still in most clouds counts as static.
    """
    keys = [_keys(cloud) for cloud in clouds]
    seen, counts = np.unique(np.concatenate([np.unique(k) for k in keys]), return_counts=True)
    static = seen[counts > _STATIC_SHARE * len(clouds)]
    steps = [
        (x << 2 * _KEY_BITS) + (y << _KEY_BITS) + z for x, y, z in product((-1, 0, 1), repeat=3)
    ]
    around = np.unique((static[:, None] + np.array(steps)).ravel())
    return [~np.isin(k, around) for k in keys]


def _keys(cloud: NDArray[np.float64]) -> NDArray[np.int64]:
    cells = np.floor(cloud / _VOXEL_M).astype(np.int64) + (1 << _KEY_BITS - 1)
    keys: NDArray[np.int64] = (
        (cells[:, 0] << 2 * _KEY_BITS) + (cells[:, 1] << _KEY_BITS) + cells[:, 2]
    )
    return keys
