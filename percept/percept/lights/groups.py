"""Lights that show the same: their evidence is summed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from percept.hdmap.light import MapLight

__all__ = ["fuse_groups", "light_groups"]


def light_groups(lights: Sequence[MapLight]) -> dict[int, int]:
    """Return for each light id the number of its group.

    Two lights are in one group if a regulatory element names both, or if a chain of such lights
    connects them.
    """
    groups = {light.light_id: number for number, light in enumerate(lights)}
    by_element: dict[int, int] = {}
    for light in lights:
        for element in light.group_ids:
            first = by_element.setdefault(element, light.light_id)
            old, new = groups[light.light_id], groups[first]
            groups = {key: new if group == old else group for key, group in groups.items()}
    return groups


def fuse_groups(
    classes: NDArray[np.float64],
    groups: NDArray[np.int64],
    seen_ns: NDArray[np.int64],
    prior: NDArray[np.float64],
    recent_ns: int,
) -> NDArray[np.float64]:
    """Return (L, 6) probabilities after all lights of each group gave their evidence.

    The evidence of a light is the log of its posterior over the prior; these add up, as each
    light is seen by itself. They are summed over answers and not over readings, since two lights
    of an approach may flash in turn. A light that was seen more than `recent_ns` before the last
    sight of its group gives none: what it says is old.
    """
    members, index = np.unique(groups, return_inverse=True)
    latest = np.full(len(members), np.iinfo(np.int64).min)
    np.maximum.at(latest, index, seen_ns)
    evidence = np.log(np.maximum(classes, 1e-12) / prior)
    evidence[seen_ns < latest[index] - recent_ns] = 0
    total = np.tile(np.log(prior), (len(members), 1))
    np.add.at(total, index, evidence)
    fused = np.exp(total - total.max(axis=1, keepdims=True))
    fused /= fused.sum(axis=1, keepdims=True)
    result: NDArray[np.float64] = fused[index]
    return result
