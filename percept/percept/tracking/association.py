"""Which detection belongs to which track: equation (1) of the report, solved by Hungarian.

cost = distance + size difference + overlap + class, each with its weight (Burnett et al.,
aUToTrack: A Lightweight Object Detection and Tracking System, 2019, equation 1), for the pairs
that pass the gates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from percept.tracking.config import AssociationWeights

__all__ = ["Candidates", "assign", "pair_costs"]

_F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """N predicted tracks, or M detections, as the cost compares them.

    Attributes:
        boxes_m: (N, 7) float64.
        variances_m2: (N, 2, 2) float64 covariance of x and y.
    """

    boxes_m: _F64
    variances_m2: _F64


def pair_costs(
    tracks: Candidates,
    seen: Candidates,
    gates_m: _F64,
    label_costs: _F64,
    weights: AssociationWeights,
) -> _F64:
    """Return the (N, M) costs of equation (1), infinite outside the gates.

    Args:
        tracks: The N tracks, predicted to the time of the detections.
        seen: The M detections.
        gates_m: (N, M) farthest distance of a pair.
        label_costs: (N, M) cost of the classes.
        weights: Of the four terms.
    """
    from percept.tracking.association_kernels import fill_pair_costs

    costs = np.empty(label_costs.shape)
    terms = (weights.distance, weights.size, weights.overlap, weights.label)
    fill_pair_costs(
        tracks.boxes_m, tracks.variances_m2, seen.boxes_m, seen.variances_m2,
        gates_m, label_costs, terms, weights.gate_sigma, costs,
    )  # fmt: skip
    return costs


def assign(costs: _F64, miss: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the pairs (rows, columns) of least total cost; a pair above `miss` is none.

    Each pair is worth what it costs less than a miss. So one good pair is never given up for
    two bad ones only because those are two.
    """
    worth = np.minimum(costs - miss, 0.0)
    rows, columns = linear_sum_assignment(worth)
    kept = worth[rows, columns] < 0
    return rows[kept], columns[kept]
